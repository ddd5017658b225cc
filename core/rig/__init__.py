"""What the instrument is and what it accepts: lenses, baseline, timing, shutter limits, settings and their checks, and
the plain geometry of one point (axis, triangulation, fields of view).

Everything else builds on this room, so it imports no other. No gate, no scene and no image belongs here.
"""
