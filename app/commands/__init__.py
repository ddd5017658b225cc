"""What each sub-command does; parsing is in `slopegate.app.cli`."""
