"""Captures on disk: recorded slice by slice, resumed, played back like a camera, exported. One export format is one
file.

What has been taken is never lost: every write goes through `files.durable`.
"""
