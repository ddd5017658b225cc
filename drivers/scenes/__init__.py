"""Reads scenes: TOML files, meshes, and folders with photo and depth. Everything is checked, nothing is executed.

`scene_files.open_scene` is the way in. What a scene is, is defined in `core.scene`.
"""
