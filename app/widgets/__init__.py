"""Building blocks that any window could use: themes, number fields, message strips, pictures.

Nothing here knows a session, a camera or a panel.
"""
