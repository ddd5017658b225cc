"""The panels of the window, one file a task: plots of the gate, mask, search, alarm, depth, slices, captures.

A new panel is a class built on `panel.Panel`, in a file of its own, and a line of the table in `panels`. Panels know
the session and the views, never each other: what they share goes over the `panel.Desk`. While it is hidden a panel
neither computes nor paints, unless the user has started something that goes on by itself.
"""
