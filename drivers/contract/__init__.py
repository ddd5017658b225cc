"""What every camera and projector is to the rest of the program: settings in, applied settings and frames out.

Types only, with the rules that hold for all of them. A vendor's name belongs in `cameras`.
"""
