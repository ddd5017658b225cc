"""Reads and writes single files: pictures, floating-point images, depth maps and rigs.

`durable` is the one way to write a file: after a crash there is the old one or the new one, never a part. `reading` is
the one way to open what anybody may have written. Nothing here knows a scene or a capture.
"""
