"""Hide an object: the gate that masks a region of the image, and how well it does.

python mask_an_object.py [FOLDER]      writes pictures before and after there
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from slopegate.app import api

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)

scene = api.open_scene("three_targets")
region = np.zeros(scene.shape, bool)  # paint whatever is to be hidden: here the target in the middle
region[240:790, 640:960] = True

found = scene.mask(region, hide=True)
print(f"overlap with the region: {found.best.iou:.2f} expected, {found.achieved_iou:.2f} counted in frames")
if not found.best.good:
    sys.exit("no gate hides this region well")

gate = found.best.sent
print(f"line time {gate.line_time_us:.3f} us, delay {gate.delay_us:.0f} us, exposure {gate.exposure_us:.0f} us")
cv2.imwrite(str(folder / "before.png"), scene.frame(scene.everything_lit) * 16)
cv2.imwrite(str(folder / "after.png"), scene.frame(gate) * 16)
