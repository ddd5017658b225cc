"""Single files: pictures, floating-point images, depth, rigs, and the one way to write a file so that a crash leaves
the old one or the new one.

Nothing here knows a scene or a capture.
"""
