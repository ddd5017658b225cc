"""Depth of every pixel by moving the gate, as a camera without depth would measure it.

python sweep_to_depth.py [FOLDER]      writes depth in metres (.npy) and a picture in colours there
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from slopegate.app import api

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)

scene = api.open_scene("spot")
measured = scene.measure_depth(finest_rows=0.5, nearest_m=0.5)
depth_m = measured.map.depth_m  # float32, NaN where unknown
print(f"{measured.map.frames} settings of the gate; equal steps would take {measured.map.plain_frames}")
if measured.error is not None:
    print(f"95 % of the pixels are off by less than {measured.error.p95_mm:.1f} mm")

np.save(folder / "depth.npy", depth_m)
near, far = np.nanpercentile(depth_m, (1, 99))
grey = np.nan_to_num(255 * (far - depth_m) / (far - near), nan=0).clip(0, 255).astype(np.uint8)
cv2.imwrite(str(folder / "depth.png"), cv2.applyColorMap(grey, cv2.COLORMAP_TURBO))
