"""Records captures slice by slice, resumes them, plays them back like a camera, and exports them.

Slices on the disk are never lost: every write goes through `files.durable`. A new export format is one module with
`write(job)` and one line in `export.FORMATS`.
"""
