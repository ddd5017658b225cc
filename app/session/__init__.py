"""What the window works on, without a widget: the open source, the wanted and the real settings, loading, preferences.

No widget is made here, and no panel is known.
"""
