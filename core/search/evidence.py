"""The evidence of the fast search: which projector row lights each keypoint, and which plane most of them lie on.

One frame asks every keypoint the same question: does the projector row that lights you pass in this window? The answers
are kept as a log-likelihood over projector rows, keypoint by keypoint. Along a plane the projector row is an affine
function of the pixel (exactly so without distortion), so a plane is three numbers; planes drawn through a few keypoints
are scored by all of them, and those that survive vote on where the next window should cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slopegate.core.gating.gate import phase_us
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings

SOFT_ROWS = 2.0
"""Within so many projector rows of a window's edge a patch may be lit in part."""
SPREAD = 0.15
"""Standard deviation of a lit share beyond what noise explains: mixed patches, light from elsewhere."""
WORST = 4.5
"""Most that one frame can speak against a row, in nats: three standard deviations."""
COIN = 0.7
"""Nats, about log 2, that a row loses where the answer could have been either. Else a surface just along the window's
edge, which may look lit here and dark there, would explain whatever is seen."""
OUTLIER = 4.0
"""Most that one keypoint can speak against a plane."""
OWN_SAY = 0.1
"""Weight of a keypoint's own evidence beside what the planes say of it."""
_DRAWS = 1000
"""Planes drawn of each kind."""
_HEATS = (0.4, 0.15, 0.05, 0.05)
"""How much worse than the best a plane may be and survive each round of moving and choosing, in nats per voter. Hot at
first, so that planes gather where many do well before the best of them take over; and never so cold that a surface
which is not quite a plane singles one out."""
_SURVIVORS = 250
_VOTERS = 200
"""Keypoints that score planes; more would only cost time."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log-likelihood (K, N_p) float32 of each projector row for each keypoint, 0 at the best."""

    log: Singles

    def updated(self, rig: Rig, rows: Doubles, settings: GateSettings, share: Doubles, noise: Doubles) -> Evidence:
        """With one more frame: camera rows (K,), lit share and its standard deviation (K,)."""
        least, most = lit_bounds(rig, settings, rows[:, None], np.arange(self.log.shape[1], dtype=np.float64) + 0.5)
        spread = np.hypot(SPREAD, noise)[:, None]
        off = np.maximum(least - share[:, None], 0.0) + np.maximum(share[:, None] - most, 0.0)
        against = np.minimum(0.5 * (off / spread) ** 2, WORST) + COIN * (least < most)
        log = self.log - against.astype(np.float32)
        # Only differences between rows count; with the best at 0 the numbers stay small however many frames come.
        return Evidence(log - log.max(axis=1, keepdims=True))


def unknown(rows_at_infinity: Doubles, height: int) -> Evidence:
    """Evidence before the first frame: light comes from in front of the rig, rows_at_infinity (K,) or later."""
    possible = np.arange(height) + 1.0 > rows_at_infinity[:, None]
    return Evidence(np.where(possible, 0.0, -50.0).astype(np.float32))


def lit_bounds(
    rig: Rig, settings: GateSettings, camera_rows: Doubles, projector_rows: Doubles
) -> tuple[Doubles, Doubles]:
    """Bounds on how much of a patch at this camera row is recorded if this projector row lights it (broadcast).

    `gate.recorded_times` for a patch that has a size. 0 or 1 both, but near an edge of the window, where the patch's
    own slope decides, anything from 0 to 1.
    """
    period, length = rig.projector.period_us, settings.exposure_us
    phases = phase_us(rig, settings.line_time_us, camera_rows, projector_rows)
    since = np.mod(phases - settings.start_us, period)
    inside = np.where(since < length, np.minimum(since, length - since), -np.minimum(since - length, period - since))
    least, most = (
        np.asarray(inside * rig.projector.rows_per_us + soft > 0, np.float64) for soft in (-SOFT_ROWS, SOFT_ROWS)
    )
    return least, most


@dataclass(frozen=True, eq=False)
class CandidatePlanes:
    """Planes (H, 3): projector row = a + b y + c x with y, x in units of half the target, and their weights (H,)."""

    coefficients: Doubles
    weights: Doubles

    def rows(self, where: Doubles) -> Doubles:
        """Projector rows (H, K) at places (K, 3) of `PlaneUnits.places`."""
        return self.coefficients @ where.T

    def mean(self) -> Doubles:
        """The weighted mean plane, (3,)."""
        return np.asarray(self.weights @ self.coefficients)

    def spread(self, where: Doubles) -> Doubles:
        """Standard deviation (K,) of the projector rows that the planes predict."""
        return np.asarray(np.sqrt(np.maximum(self.weights @ (self.rows(where) - self.mean() @ where.T) ** 2, 0.0)))


@dataclass(frozen=True)
class PlaneUnits:
    """Pixels to the units of `CandidatePlanes`, and how steep a plane may be in them."""

    column: float
    row: float
    half_width: float
    half_height: float
    slope: tuple[float, float]
    """Projector rows per camera row, at least and at most."""
    skew: float
    """Projector rows per camera column, at most."""

    def places(self, columns: Doubles, rows: Doubles) -> Doubles:
        """(K, 3): 1, y, x."""
        y = (rows - self.row) / self.half_height
        return np.stack([np.ones_like(y), y, (columns - self.column) / self.half_width], axis=1)


def frame_of(columns: Doubles, rows: Doubles, slope: tuple[float, float], skew: float) -> PlaneUnits:
    """The units for these keypoints."""
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1.0)
    return PlaneUnits(float(middle[0]), float(middle[1]), float(half[0]), float(half[1]), slope, skew)


def vote(
    evidence: Evidence, where: Doubles, frame: PlaneUnits, before: CandidatePlanes | None, rng: np.random.Generator
) -> CandidatePlanes:
    """Planes that agree with the evidence, drawn anew and from those of the frame before (importance resampling).

    Three kinds are drawn: any slopes through one keypoint, planes through three keypoints, and former planes moved a
    little. Each keypoint's say is limited, so that what does not lie on the plane cannot pull at it.
    """
    # Resampled in rounds that get colder, as in a particle filter: at once, the few best draws of the first round would
    # crowd out planes that are nearly as good and only need to be moved a little.
    voters = rng.permutation(len(where))[:_VOTERS]
    log, at = evidence.log[voters], where[voters]
    # New planes beside the former ones every time: a vote that went wrong early can still be put right.
    drawn = [_through_one(evidence, where, frame, rng), _through_three(evidence, where, rng)]
    planes = before
    for heat in _HEATS:
        if planes is not None:
            drawn.append(_moved(planes, rng))
        every = np.concatenate(drawn)
        every = every[_possible(every, frame)]
        planes = _survivors(every, _scores(log, every @ at.T) / (heat * len(voters)), rng)
        drawn = [planes.coefficients]
    assert planes is not None
    return planes


def _survivors(planes: Doubles, scores: Doubles, rng: np.random.Generator) -> CandidatePlanes:
    """Planes drawn by their scores, good ones many times: systematic resampling with one random number."""
    weights = np.exp(scores - scores.max())
    chosen = np.searchsorted(np.cumsum(weights / weights.sum()), (np.arange(_SURVIVORS) + rng.random()) / _SURVIVORS)
    kept = planes[np.minimum(chosen, len(planes) - 1)]
    return CandidatePlanes(kept, np.full(len(kept), 1 / len(kept)))


def agreeing(evidence: Evidence, rows: Doubles) -> Bools:
    """Keypoints (K,) that may well lie where a plane has these projector rows (K,)."""
    return np.asarray(_at(evidence.log, rows[None, :])[0] > -0.75 * OUTLIER)


def _scores(log: Singles, rows: Doubles) -> Doubles:
    """How well planes (H,) fit the evidence, in nats; what one keypoint can say against a plane is limited."""
    return np.asarray(np.maximum(_at(log, rows), -OUTLIER).sum(axis=1))


def _at(log: Singles, rows: Doubles) -> Singles:
    """Log-likelihoods (H, K) at rows (H, K); -50 outside the projector."""
    index = np.floor(rows).astype(np.int64)
    inside = (index >= 0) & (index < log.shape[1])
    return np.where(inside, log[np.arange(log.shape[0]), np.clip(index, 0, log.shape[1] - 1)], np.float32(-50))


def _draw_rows(evidence: Evidence, chosen: Indices, rng: np.random.Generator) -> Doubles:
    """One projector row for each chosen keypoint, from what is known of it."""
    sums = np.cumsum(np.exp(evidence.log), axis=1)
    wanted = rng.random(chosen.size) * sums[chosen, -1]
    rows = (sums[chosen] < wanted[:, None]).sum(axis=1)
    return np.asarray(rows + rng.random(chosen.size))


def _through_one(evidence: Evidence, where: Doubles, frame: PlaneUnits, rng: np.random.Generator) -> Doubles:
    """Planes (H, 3) of random slopes, each through a keypoint at a row drawn from its evidence."""
    chosen = rng.integers(0, len(where), _DRAWS)
    rows = _draw_rows(evidence, chosen, rng)
    b = rng.uniform(*frame.slope, _DRAWS) * frame.half_height
    c = rng.uniform(-frame.skew, frame.skew, _DRAWS) * frame.half_width
    a = rows - b * where[chosen, 1] - c * where[chosen, 2]
    return np.stack([a, b, c], axis=1)


def _through_three(evidence: Evidence, where: Doubles, rng: np.random.Generator) -> Doubles:
    """Planes (H, 3) through three keypoints each, at rows drawn from their evidence."""
    chosen = rng.integers(0, len(where), (_DRAWS, 3))
    rows = _draw_rows(evidence, chosen.ravel(), rng).reshape(-1, 3)
    corners = where[chosen]
    # twice the triangle's area; keypoints side by side say nothing of slopes
    wide = np.abs(np.linalg.det(corners)) > 0.2
    return np.asarray(np.linalg.solve(corners[wide], rows[wide][..., None])[..., 0])


def _moved(before: CandidatePlanes, rng: np.random.Generator) -> Doubles:
    """Each survivor four times, moved by a random share of how far they lie apart."""
    many = np.repeat(before.coefficients, 4, axis=0)
    spread = before.coefficients.std(axis=0) + 0.3
    return np.asarray(many + rng.normal(size=many.shape) * spread * rng.uniform(0.1, 1.0, (len(many), 1)))


def _possible(planes: Doubles, frame: PlaneUnits) -> Bools:
    """Which planes (H,) a gate could follow."""
    slope, skew = planes[:, 1] / frame.half_height, planes[:, 2] / frame.half_width
    return (slope >= frame.slope[0]) & (slope <= frame.slope[1]) & (np.abs(skew) <= frame.skew)


def best_cut(
    rig: Rig, planes: CandidatePlanes, evidence: Evidence, where: Doubles, rows: Doubles, line_time_us: float
) -> float:
    """Start of row coordinate 0 (us) of the half-period window that is expected to tell the most.

    rows (K,): camera rows. What a window tells is the variance of its answers, summed over keypoints: as the planes
    predict them, and with a lesser weight as each keypoint's own evidence does. Without the latter, planes that explain
    two surfaces at once, and all agree, would ask the same question again and again.
    """
    period = rig.projector.period_us
    bins = max(int(rig.projector.period_rows), 2) // 2 * 2

    def lit_shares(ahead: Doubles, weights: NDArray[np.floating]) -> Doubles:
        """(K, bins): weight of ahead (K, n) inside the half period that begins with each bin."""
        phase = np.mod(phase_us(rig, line_time_us, rows[:, None], ahead), period) * (bins / period)
        index = np.minimum(phase.astype(np.int64), bins - 1) + bins * np.arange(len(rows))[:, None]
        flat = np.bincount(index.ravel(), np.broadcast_to(weights, index.shape).ravel(), bins * len(rows))
        # Twice round the period, so that a window that wraps is one difference of sums like any other.
        sums = np.cumsum(np.tile(flat.reshape(len(rows), bins), 2), axis=1)
        return np.asarray(sums[:, bins // 2 : bins // 2 + bins] - sums[:, :bins])

    own = np.exp(evidence.log)
    by_plane = lit_shares(planes.rows(where).T, planes.weights)
    by_own = lit_shares(np.arange(own.shape[1], dtype=np.float64)[None, :] + 0.5, own / own.sum(axis=1, keepdims=True))
    # The variance of a yes-or-no answer of chance p is p (1 - p): greatest where as many planes say yes as no.
    told = (by_plane * (1 - by_plane)).sum(axis=0) + OWN_SAY * (by_own * (1 - by_own)).sum(axis=0)
    return (int(np.argmax(told)) + 1) * period / bins
