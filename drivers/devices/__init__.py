"""What is plugged in: one list of camera families, boards and USB devices, and how to open each of them.

The only room of the drivers that knows them all.
"""
