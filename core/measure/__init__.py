"""What is read from gated images: depth by a sweep, the best gate for a mask, stacks of slices, an alarm.

Functions over arrays. Whatever takes the images stands in the drivers.
"""
