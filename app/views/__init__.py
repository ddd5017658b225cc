"""What shows the frame and the gate: the live image with its overlays, the slab in 3D and in section, the timing.

Views show a session; what changes it by a task of its own is a panel.
"""
