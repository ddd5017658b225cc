"""The published schema of captures, made from the models. Run this file to write it anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from slopegate.drivers.captures.model import Sidecar

PUBLISHED = Path(__file__).resolve().parents[2] / "resources" / "schemas" / "capture.schema.json"


def json_schema() -> dict[str, Any]:
    """The schema of `Sidecar` (JSON Schema 2020-12)."""
    draft = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Slopegate capture"}
    return {**draft, **{key: value for key, value in Sidecar.model_json_schema().items() if key != "title"}}


if __name__ == "__main__":
    PUBLISHED.write_text(json.dumps(json_schema(), indent=2) + "\n", encoding="utf-8")
