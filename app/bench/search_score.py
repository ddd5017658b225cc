"""Both searches on scenes whose truth is known: what they find, how well, and in how many frames."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slopegate.app.bench.search_cases import Case, make_cases
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.sensor import Plates, SensorModel, auto_gain, expose_fast, mono, noise_pool
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.gating.plan import gate_around
from slopegate.core.rig.arrays import Bools
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.core.search.paper import line_times
from slopegate.core.search.search import ask, begin, tell
from slopegate.core.search.state import METHODS, MIN_KEYPOINTS, Method, Outcome, State
from slopegate.drivers.files.durable import write_durably

COVERED = 0.8
"""An answer is right when its gate records this share of the target's lit pixels ..."""
ISOLATED = 0.8
"""... and has this share of the intersection over union that the rig's best gate has."""
POSSIBLE_IOU = 0.7
"""Where even the best gate does not reach this, what surrounds the target lies in one slab with it: not findable."""
MAJORITY = 0.5
"""Share of the keypoints in the rectangle that must lie on the target."""
SPARE_ROWS = 1.0
"""What that best gate has to spare before and behind the target: less is luck."""
LIT_SHARE = 0.6
"""Share of the target in its rectangle that must lie in the projector's light to be findable."""


@dataclass(frozen=True)
class Result:
    """One method on one case."""

    case: int
    kind: str
    name: str
    method: Method
    findable: bool
    why_not: str
    cause: str
    found: bool
    covers: bool
    right: bool
    wrong: bool
    kept: int
    keypoints: int
    frames: int
    iou: float
    iou_inside: float
    best_iou: float
    tilt_deg: float
    distance_m: float


def run(cases: int, seed: int, out: Path | None, say: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Score both methods on so many seeded cases; the report also goes to `out` as JSON where that is given."""
    results: list[Result] = []
    for case in make_cases(cases, seed):
        results += score(case)
        if say is not None:
            say(f"{case.index + 1} of {cases}")
    report = {
        "cases": cases,
        "seed": seed,
        "limits": {"covered": COVERED, "isolated": ISOLATED, "possible_iou": POSSIBLE_IOU, "lit_share": LIT_SHARE},
        "summary": summary(results),
        "results": [asdict(result) for result in results],
    }
    if out is not None:
        write_durably(out, json.dumps(report, indent=1).encode())
    return report


def score(case: Case) -> Iterator[Result]:
    """Both methods on one case."""
    best = best_gate(case)
    shown, (x0, y0, x1, y1) = case.truth & case.lit, case.target
    lit_share = float(shown[y0:y1, x0:x1].sum() / max(case.truth[y0:y1, x0:x1].sum(), 1))
    for method in METHODS:
        state = search_case(case, method)
        outcome = state.outcome
        assert outcome is not None
        why = _why_not(outcome, best, lit_share, on_target(state, shown))
        whole, inside, covered = (0.0,) * 3 if outcome.settings is None else overlap(case, outcome.settings)
        covers = covered >= COVERED  # 0 without a gate
        right = covers and whole >= ISOLATED * best
        yield Result(
            case=case.index,
            kind=case.kind,
            name=case.name,
            method=method,
            findable=not why,
            why_not=why,
            cause=outcome.cause,
            found=outcome.found,
            right=right,
            wrong=outcome.found and not covers,
            covers=covers,
            kept=outcome.kept,
            keypoints=outcome.keypoints,
            frames=outcome.frames,
            iou=whole,
            iou_inside=inside,
            best_iou=best,
            tilt_deg=case.tilt_deg,
            distance_m=case.distance_m,
        )


def search_case(case: Case, method: Method) -> State:
    """Run one method on one case to its end, with noise."""
    buffers, rig = case.buffers, case.rig
    direct, ambient = mono(buffers.direct), mono(buffers.ambient)
    sensor = auto_gain(direct + ambient, SensorModel())
    plates = Plates(buffers.projector_row, direct, ambient, sensor)
    pool = noise_pool(np.random.default_rng(case.seed), rig.camera.lens.width)
    image = np.empty(direct.shape, np.uint16)
    state = begin(rig, case.target, method, sensor.black_count, seed=case.seed)
    while (settings := ask(state)) is not None:
        windows = kernel_windows(row_windows(rig, settings))
        periods = settings.exposure_us / rig.projector.period_us
        expose_fast(plates, windows, periods, pool.frame(case.seed, state.frames), image)
        state = tell(state, image, settings)
    return state


def on_target(state: State, shown: Bools) -> float:
    """Share of the keypoints that lie on the target's lit pixels (H, W)."""
    points = state.points
    if points is None or not len(points):
        return 0.0
    return float(shown[points.rows.astype(int), points.columns.astype(int)].mean())


def overlap(case: Case, settings: GateSettings) -> tuple[float, float, float]:
    """Intersection over union with the target's lit pixels in the whole image and in the rectangle; share covered."""
    recorded = (weights(row_windows(case.rig, settings), case.buffers.projector_row) > 0) & ~case.ignored
    x0, y0, x1, y1 = case.target
    inside = (slice(y0, y1), slice(x0, x1))
    truth = case.truth & case.lit
    covered = float((recorded & truth).sum() / max(truth.sum(), 1))
    return _iou(recorded, truth), _iou(recorded[inside], truth[inside]), covered


def best_gate(case: Case) -> float:
    """The best overlap (whole image) of any clock, with delay and exposure from the true surface and a row to spare."""
    rows, columns = np.nonzero((case.truth & case.lit)[::4, ::4])
    if rows.size == 0:
        return 0.0
    ahead = case.buffers.projector_row[rows * 4, columns * 4].astype(np.float64)
    seen_by = (rows * 4).astype(np.float64)
    lines = line_times(begin(case.rig).task)
    gates = sorted((gate_around(case.rig, seen_by, ahead, line) for line in lines), key=lambda gate: gate.exposure_us)
    limits, projector = case.rig.camera.shutter, case.rig.projector
    spare = 2 * SPARE_ROWS / projector.rows_per_us
    # no clock does better than those with the thinnest gates
    wide = [replace(gate, exposure_us=gate.exposure_us + spare) for gate in gates[:6]]
    return max(overlap(case, quantise(limits, gate, projector.period_us))[0] for gate in wide)


def _why_not(outcome: Outcome, best: float, lit_share: float, on: float) -> str:
    if lit_share < LIT_SHARE:
        return "out of the projector's light"
    if outcome.keypoints < MIN_KEYPOINTS:
        return "too few keypoints"
    if on < MAJORITY:
        return "most keypoints lie beside it"
    return "no gate isolates it" if best < POSSIBLE_IOU else ""


def _iou(one: Bools, two: Bools) -> float:
    union = int((one | two).sum())
    return float((one & two).sum() / union) if union else 0.0


def summary(results: list[Result]) -> dict[str, Any]:
    """Shares and medians of both methods over the findable cases."""
    table: dict[str, Any] = {method: _column([r for r in results if r.method == method]) for method in METHODS}
    right = {
        method: {r.case: r.frames for r in results if r.method == method and r.findable and r.covers}
        for method in METHODS
    }
    both = sorted(right["fast"].keys() & right["paper"].keys())
    table["both_cover"] = len(both)
    table["median_frames_where_both_cover"] = {
        method: _median([right[method][case] for case in both]) for method in METHODS
    }
    return table


def _column(results: list[Result]) -> dict[str, Any]:
    findable = [r for r in results if r.findable]
    right, gated = [r for r in findable if r.right], [r for r in findable if r.found or r.cause == "part"]
    reasons = sorted({r.why_not for r in results if r.why_not})
    return {
        "cases": len(results),
        "findable": len(findable),
        "not_findable": {reason: sum(r.why_not == reason for r in results) for reason in reasons},
        "covers": sum(r.covers for r in findable),
        "right": len(right),
        "right_share": len(right) / len(findable) if findable else None,
        "part": sum(r.cause == "part" for r in findable),
        "wrong": sum(r.wrong for r in findable),
        "wrong_not_findable": sum(r.wrong for r in results if not r.findable),
        "median_frames": _median([r.frames for r in findable]),
        "median_iou": _median([r.iou for r in findable]),
        "median_iou_inside": _median([r.iou_inside for r in findable]),
        "median_best_iou": _median([r.best_iou for r in findable]),
        "median_kept_share": _median([r.kept / max(r.keypoints, 1) for r in gated]),
    }


def _median(values: list[float] | list[int]) -> float | None:
    return float(np.median(values)) if values else None
