"""Sync boards and delay generators on serial ports, and cameras whose delay they make.

A new board is one dialect and one line in `boards`.
"""
