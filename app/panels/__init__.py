"""The tasks of the window, one file each: mask, search, depth, alarm, slices. A new panel is one file and one line in
`panels`.

Panels know the session and the views, never each other.
"""
