"""The manifest of an acquisition."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from slopegate.drivers.transports.model import TransportManifest


def _text(**changed: object) -> dict[str, object]:
    camera = {
        "name": "c", "width": 4, "height": 3, "pixel_format": "mono12", "max_count": 4095, "black_count": 40.0,
    }  # fmt: skip
    facts: dict[str, object] = {
        "created": "2026-01-01T00:00:00Z", "software": "slopegate", "scene": "s", "rig_toml": "", "camera": camera,
        "raster": [8, 8], "grid": [4, 2], "codes": "hadamard", "frames": 1, "settle_frames": 0, "slices": [None],
        "counts_per_unit": None, "seed": None, "parts": [],
    }  # fmt: skip
    return facts | changed


def test_a_manifest_survives_json() -> None:
    import json

    made = TransportManifest.model_validate_json(json.dumps(_text()))
    assert TransportManifest.model_validate_json(made.model_dump_json()) == made


@pytest.mark.parametrize("changed", [{"slices": []}, {"codes": "other"}, {"frames": 0}, {"counts_per_unit": 0.0}])
def test_a_manifest_that_makes_no_sense_is_refused(changed: dict[str, object]) -> None:
    import json

    with pytest.raises(ValidationError):
        TransportManifest.model_validate_json(json.dumps(_text(**changed)))
