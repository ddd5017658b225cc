"""Finding the gate of a target from images alone: what to try next, what was seen, when to stop.

A search asks for a picture and is given one; it never holds a camera, a thread or a clock.
"""
