"""A rig's calibration from pictures: charts and their corners, Gray code through the projector, lenses and pose with
the uncertainty of each of their numbers, and the timing of the gate.

Functions over arrays; a rig comes out. What shows patterns, takes and reads pictures stands in the drivers.
"""
