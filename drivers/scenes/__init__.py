"""Scenes from files: TOML, meshes, folders with photo and depth. Everything is checked, nothing is executed.

What a scene is stands in `core.scene`; this room only reads it.
"""
