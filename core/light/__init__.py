"""Light that does not come straight from the surface that a pixel sees: scattered by fog, between surfaces, under skin.

Each part is prepared once for a rig and a scene, and then adds what a gate records of it to an image. Direct and
ambient light belong to `render` and `exposure`; files belong to drivers.
"""
