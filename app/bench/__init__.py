"""Run time against error of every way to make a gated frame, and the score of the searches.

It measures core and drivers as they are; no part of the program depends on it, except its command.
"""
