"""Light transport: which block of the projector lights which pixel of the camera, slice by slice.

Coded patterns and their decoding, transport kept sparse, relighting and compositing with it. Functions over arrays:
what shows patterns, takes frames and keeps files stands in the drivers.
"""
