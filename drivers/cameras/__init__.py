"""Cameras: the virtual one and its faults, films and pictures, and one driver for each family of real ones.

Each fulfils the contract and passes its tests. Packages of vendors are imported when a camera is opened, never
before.
"""
