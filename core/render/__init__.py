"""From a scene and a rig to the buffers of one picture: which projector row lights each pixel, how bright, how far.

Buffers hold for every gate; choosing a gate, and what a sensor counts, is the room `exposure`.
"""
