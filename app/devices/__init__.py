"""Dialogs and menus for cameras, sync boards and the projector, and what is remembered of each.

The drivers do the work; here is what the user sees of it.
"""
