"""Lists what is plugged in (cameras, sync boards, USB devices) and opens it.

This is the only room of the drivers that knows every family of devices.
"""
