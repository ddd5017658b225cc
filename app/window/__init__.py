"""The main window: the live image, the panels docked around it in workspaces, the gate's controls, menus and status.

It passes on what one part wants of another and remembers how all of it is arranged.

Nothing below imports it.
"""
