"""Slope disparity gating as pure computation: settings in, numbers and images out; no window, file, clock or thread."""
