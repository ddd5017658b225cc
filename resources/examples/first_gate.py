"""A first gate: one tilted slab of a scene, everything but that slab, and the fully lit image.

python first_gate.py [FOLDER]      writes three 16-bit pictures there
"""

import sys
from pathlib import Path

import cv2

from slopegate.app import api

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)

scene = api.open_scene("three_targets")
planned = scene.plan(tilt_deg=15, distance_m=1.05, thickness_m=0.1)
gate = planned.applied  # as the camera makes it: clocks, delays and exposures come in steps
slab = planned.slab
print(f"asked for a tilt of 15 degrees, got {slab.tilt_deg:.2f}, at {slab.distance_m:.3f} m")

pictures = {"gated": gate, "rest": scene.complement(gate), "lit": scene.everything_lit}
for name, settings in pictures.items():
    counts = scene.frame(settings, seed=1)  # 12 bits, with noise; scene.light(settings) has the light itself
    cv2.imwrite(str(folder / f"{name}.png"), counts * 16)
    print(f"{name}.png: {scene.recorded(settings).mean():.1%} of the pixels receive light of the projector")
