"""From settings to the slab of space they light, and back: windows of every camera row, planes, hinge, plans and
slices.

It knows the rig and nothing else. A scene, an image or a search belongs elsewhere.
"""
