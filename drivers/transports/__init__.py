"""Acquisitions of light transport: the run that joins projector and camera, and the folder that it fills.

Drivers' contracts, files and `core.transport` come in. Qt and the command line stay out.
"""
