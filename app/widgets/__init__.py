"""Widgets and drawing aids that any window could use: themes, number fields, messages, pictures.

They know no session, no camera and no panel.
"""
