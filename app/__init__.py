"""The window, the command line, and `slopegate.app.api` for scripts and notebooks."""
