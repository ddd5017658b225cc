"""The main window: it puts views, panels and menus together and passes what one says to the others.

Nothing below imports it.
"""
