"""How loops are compiled, and when what was compiled in an earlier run may be used again.

Every kernel of the program takes `njit` from here instead of from numba. Nothing that computes belongs here, and it
imports no other room.
"""
