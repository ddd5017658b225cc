"""From buffers and a gate to an image: exact row windows, light as float32, and the counts of a sensor with its noise.

This is the hot path of every live frame. Nothing here knows where the buffers came from.
"""
