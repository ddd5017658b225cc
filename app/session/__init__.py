"""What the window looks at and what the user wants of it: sources, settings, loading, preferences, and the log.

Nothing here makes a widget or knows a panel.
"""
