"""Sync boards and delay generators on serial ports: their dialects, the line itself, and the delay that they make.

A new board is one dialect and one line in `boards`.
"""
