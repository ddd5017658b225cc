"""Whatever blocks, waits or touches a wire or a file: cameras, streams, scene and image files; no window."""
