"""`python -m slopegate.app`: the command line."""

from slopegate.app.cli import program

program()
