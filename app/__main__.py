"""`python -m slopegate.app`: the command line."""

import sys

from slopegate.app.cli import main

sys.exit(main())
