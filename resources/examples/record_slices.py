"""Record a scene slice by slice, then read the capture back: its gates, its images, its depth.

python record_slices.py [FOLDER]      writes the capture and a picture of all slices in colours there
"""

import sys
from pathlib import Path

import cv2

from slopegate.app import api

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")

scene = api.open_scene("spot")
gates = scene.plan_lit_slices(12)  # they share their edges, so their images add up to the fully lit one
scene.record(folder / "capture", gates, frames=2, dark=True, say=print)

capture = api.open_capture(folder / "capture")  # any time later, on any computer
for place, gate in enumerate(capture.gates):  # farthest first
    slab, light = capture.slab(gate), capture.light(place)
    print(f"slice at {slab.distance_m:.3f} m, {slab.thickness_m:.3f} m thick: {light.mean():.1f} counts in the mean")

overlay = capture.stack.overlay  # RGB, float32, a colour for each slice
picture = (255 * (overlay / overlay.max()).clip(0, 1) ** 0.45).astype("uint8")
cv2.imwrite(str(folder / "slices.png"), picture[:, :, ::-1])
