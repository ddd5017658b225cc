"""The commands of `slopegate`, one file each: what it takes (`arguments`) and what it does (`run`).

A command reads its options, calls `slopegate.app.api`, prints, and returns an exit code. What it computes stands in
`core` and `drivers`, so that a script can have it too. `registry.py` has a line for each.
"""
