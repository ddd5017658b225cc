"""Takes and reads what a calibration is made of: Gray-code pictures of a chart, gated pictures of a plane, and the
facts about them that a rig file keeps.

Reads folders and drives cameras and projectors; what it computes with stands in the core's room `calibration`.
"""
