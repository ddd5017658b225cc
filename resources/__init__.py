"""Files that ship with the program: rigs, scenes and pictures.

They are read through `importlib.resources.files("slopegate.resources")`, so they are found in a checkout and in an
installed wheel alike.
"""
