"""Connecting cameras, boards and the projector from the window: dialogs, menus, what is remembered of each.

The drivers do the work; here stands what the user sees of it.
"""
