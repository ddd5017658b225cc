"""What a scene is made of: objects, their shapes and paths, a measured depth map, and the gates that it names.

Reading a scene from a file is the drivers' work; drawing it is that of `render`.
"""
