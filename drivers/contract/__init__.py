"""The contracts that cameras, projectors and taps keep: settings go in, applied settings and frames come out.

Types only, with the rules that hold for all of them. A vendor's name belongs in `cameras`.
"""
