"""The sub-commands of `slopegate`, one file each: what it takes and what it does.

Commands print and return an exit code. What they compute stands in core and drivers, so that a script can have it
too.
"""
