"""The compiled loops that read a gate's airlight from the table: two profiles a camera row, and a maximum a pixel.

Projector row r is met where g = (Q_y - s Q_z) - w (O_y - s O_z) is 0, s = (r - c_y) / f_y, and rows from r on lie where
g >= 0: one comparison whatever the rig, also where the row hardly changes along the ray. So a window is an interval of
w on each ray. The table rises with w, so clipping is the larger and the smaller of two numbers:
light = max(0, min(P(last), P(nearest lit)) - max(P(first), P(surface))).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.airlight_table import TILE, AirTable, Limits
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3


class ProjectorRows(NamedTuple):
    """The projector's rows: the offset in its axes, and for a distorted lens `fill_slopes` (h, m, w), else (0, 0, 0).

    straight: every projector row crosses all rays of a camera row at one w.
    """

    offset: Vector3
    slopes: Singles
    straight: bool


class RowEdges(NamedTuple):
    """The windows of camera rows (H,): where they begin and end, as slopes y/z of a pinhole and as shares of all
    rows (H, 2); how often what lies between counts beside the rest, and how often the rest counts."""

    slopes: Doubles
    shares: Doubles
    part: Singles
    whole: Singles


class Profiles(NamedTuple):
    """Of one camera row, at each coarse column (w,): the slopes of its window's edges, the w and the continuous nodes
    at which it begins and ends, the light beyond these; that at every pixel (W,), near and far; and for
    images of several channels the light of the pixels (1, W).

    Room for the loops, filled anew for each row.
    """

    low: Singles
    high: Singles
    start: Singles
    end: Singles
    above: Singles
    below: Singles
    first: Singles
    last: Singles
    near: Singles
    far: Singles
    pixels: Singles


class EdgePixels(NamedTuple):
    """Pixels whose rays meet surfaces that no plane joins: column (E,), the light beyond the surface of each ray
    (E, N, N), row by row of rays; first (H + 1,): where the pixels of each camera row begin."""

    column: Ints
    beyond: Singles
    first: Indices


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _reciprocal(change: np.float32) -> np.float32:
    """1 / change within what float32 holds, never of 0: a ray that runs along an edge lies to one side of it."""
    far = np.float32(1e30)
    return -far if change == 0 else min(max(np.float32(1) / change, -far), far)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_window(
    seen: Singles, r: int, t: np.float32, offset: Vector3, slopes: tuple[float, float], start: Singles, end: Singles
) -> None:
    """The w between which coarse rays cross the rows between two slopes, (w,) each; anything below 0 for infinity."""
    low, high, far = np.float32(slopes[0]), np.float32(slopes[1]), np.float32(1e35)
    to_low = _reciprocal(np.float32(offset[1] - slopes[0] * offset[2]))
    to_high = _reciprocal(np.float32(offset[1] - slopes[1] * offset[2]))
    rising_low, rising_high = to_low < 0, to_high < 0
    k, zero, one, two = np.uint64(r), np.uint64(0), np.uint64(1), np.uint64(2)
    for j in range(zero, np.uint64(start.shape[0])):
        y = seen[k, one, j] + t * (seen[k + one, one, j] - seen[k, one, j])
        z = seen[k, two, j] + t * (seen[k + one, two, j] - seen[k, two, j])
        at_low, at_high = (y - low * z) * to_low, (y - high * z) * to_high
        # Rows rise with w, or fall: an edge is where the window begins, or ends.
        start[j] = max(at_low if rising_low else -far, -far if rising_high else at_high)
        end[j] = min(far if rising_low else at_low, at_high if rising_high else far)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_bent_window(seen: Singles, r: int, t: np.float32, offset: Vector3, out: Profiles) -> None:
    """`_fill_window` for a distorted projector: each coarse ray meets the window's edges at slopes of its own."""
    oy, oz, far = np.float32(offset[1]), np.float32(offset[2]), np.float32(1e35)
    k, zero, one, two = np.uint64(r), np.uint64(0), np.uint64(1), np.uint64(2)
    for j in range(zero, np.uint64(out.start.shape[0])):
        y = seen[k, one, j] + t * (seen[k + one, one, j] - seen[k, one, j])
        z = seen[k, two, j] + t * (seen[k + one, two, j] - seen[k, two, j])
        to_low, to_high = _reciprocal(oy - out.low[j] * oz), _reciprocal(oy - out.high[j] * oz)
        at_low, at_high = (y - out.low[j] * z) * to_low, (y - out.high[j] * z) * to_high
        out.start[j] = max(at_low if to_low < 0 else -far, -far if to_high < 0 else at_high)
        out.end[j] = min(far if to_low < 0 else at_low, at_high if to_high < 0 else far)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_places(rows: Doubles, k: int, w: Singles, nodes: int, out: Singles) -> None:
    """`node_at` of coarse row k at the inverse depths w (w,)."""
    a, nearest = np.float32(rows[k, 0]), np.float32(rows[k, 1])
    p, q, count = np.float32(rows[k, 2]), np.float32(rows[k, 3]), np.float32(nodes)
    for j in range(np.uint64(0), np.uint64(w.shape[0])):
        here = min(max(w[j], a), nearest)
        out[j] = min(max(count * (here - a) / (p * here + q), np.float32(0)), count)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_run(light: Singles, r: int, place: np.float32, share: np.float32, fresh: bool, out: Singles) -> None:
    """`_fill_rows` at one place for all columns: two runs of contiguous numbers."""
    i = min(int(place), light.shape[1] - 2)
    u = place - np.float32(i)
    k, m, one = np.uint64(r), np.uint64(i), np.uint64(1)
    for j in range(np.uint64(0), np.uint64(out.shape[0])):
        value = share * (light[k, m, j] + u * (light[k, m + one, j] - light[k, m, j]))
        out[j] = value if fresh else out[j] + value


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_rows(light: Singles, r: int, places: Singles, share: np.float32, fresh: bool, out: Singles) -> None:
    """A share of coarse row r at the nodes `places`, (w,) or one for all, into out (w,), or onto it unless fresh."""
    if places.shape[0] == 1:
        _fill_run(light, r, places[0], share, fresh, out)
        return
    k, one, most = np.uint64(r), np.uint64(1), np.int32(light.shape[1] - 2)
    for j in range(np.uint64(0), np.uint64(out.shape[0])):
        i = min(np.int32(places[j]), most)
        u, m = places[j] - np.float32(i), np.uint64(i)
        value = share * (light[k, m, j] + u * (light[k, m + one, j] - light[k, m, j]))
        out[j] = value if fresh else out[j] + value


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_profiles(table: AirTable, raster: ProjectorRows, edges: RowEdges, k: int, part: float, out: Profiles) -> None:
    """The light beyond the ends of camera row k's window as its row of rays at this part of it, 0..1, meets them.

    The table is read at the middle of the row, as it is for surfaces.
    """
    light, nodes = table.light, table.light.shape[1] - 1
    y, middle = (k + part) / table.step, (k + 0.5) / table.step
    s, r = min(int(y), light.shape[0] - 2), min(int(middle), light.shape[0] - 2)
    across, t = np.float32(y - s), np.float32(middle - r)
    # Where all rays of a row meet an edge at the same w, the first column stands for all.
    columns = 1 if raster.straight else light.shape[2]
    start, end = out.start[:columns], out.end[:columns]
    if raster.slopes.shape[0] > 0:
        most = raster.slopes.shape[1] - 1
        for i in range(2):
            place = np.float32(most * min(max(edges.shares[k, i], 0.0), 1.0))
            met = out.low if i == 0 else out.high
            _fill_run(raster.slopes, s, place, np.float32(1) - across, True, met)
            _fill_run(raster.slopes, s + 1, place, across, False, met)
        _fill_bent_window(table.seen, s, across, raster.offset, out)
    else:
        slopes = (edges.slopes[k, 0], edges.slopes[k, 1])
        _fill_window(table.seen, s, across, raster.offset, slopes, start, end)
    above, below = out.above[:columns], out.below[:columns]
    for w, profile in ((start, out.first), (end, out.last)):
        _fill_places(table.rows, r, w, nodes, above)
        _fill_places(table.rows, r + 1, w, nodes, below)
        _fill_rows(light, r, above, np.float32(1) - t, True, profile)
        _fill_rows(light, r + 1, below, t, False, profile)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _stretch(profile: Singles, step: int, out: Singles) -> None:
    """The profile (w,), which stands at every `step`-th border of pixels, at the middles of the pixels (W,)."""
    done = 0
    if step == 4:
        one, two, three, quarter = np.uint64(1), np.uint64(2), np.uint64(3), np.float32(0.25)
        for cell in range(np.uint64(out.shape[0] // 4)):
            change = (profile[cell + one] - profile[cell]) * quarter
            value, first = profile[cell] + np.float32(0.5) * change, cell * np.uint64(4)
            out[first], out[first + one] = value, value + change
            out[first + two], out[first + three] = value + np.float32(2) * change, value + np.float32(3) * change
        done = out.shape[0] // 4 * 4
    for j in range(done, out.shape[0]):
        c = j // step
        out[j] = profile[c] + np.float32((j - c * step + 0.5) / step) * (profile[c + 1] - profile[c])


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_between(
    room: Profiles, limits: Limits, line: int, step: int, weight: np.float32, out: Singles, row: int
) -> None:
    """Add weight times the light between the two profiles and within the limits of camera row `line` to out[row]."""
    first, last = room.first, room.last
    _stretch(first, step, room.near)
    _stretch(last, step, room.far)
    near, far, o = room.near, room.far, np.uint64(row)
    beyond, every, k = limits.beyond, limits.every, np.uint64(line)
    width, zero = every.shape[1], np.float32(0)
    for tile in range(limits.least_every.shape[1]):
        left, right = tile * TILE, min((tile + 1) * TILE, width)
        c0, c1 = left // step, (right - 1) // step + 1
        low, top = first[c0], last[c0]
        for c in range(c0 + 1, c1 + 1):
            low, top = min(low, first[c]), max(top, last[c])
        if limits.least_beyond[line, tile] >= top or low >= top:
            continue  # all surfaces lie in front of the gate's light
        # Arrays are indexed whole: a view of a run costs more than the run.
        begin, stop = np.uint64(left), np.uint64(right)
        if limits.least_every[line, tile] < top:
            # Pixels also are not lit as far as the window reaches towards the camera.
            for j in range(begin, stop):
                out[o, j] += weight * max(min(far[j], every[k, j]) - max(near[j], beyond[k, j]), zero)
        elif limits.most_beyond[line, tile] > low:
            for j in range(begin, stop):
                out[o, j] += weight * max(far[j] - max(near[j], beyond[k, j]), zero)
        else:
            # All surfaces lie beyond the gate's light, and need not be looked at.
            for j in range(begin, stop):
                out[o, j] += weight * max(far[j] - near[j], zero)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_every(limits: Limits, line: int, weight: np.float32, out: Singles, row: int) -> None:
    """Add weight times all light before the surfaces of camera row `line` to out[row]."""
    k, o = np.uint64(line), np.uint64(row)
    for j in range(np.uint64(0), np.uint64(limits.every.shape[1])):
        out[o, j] += weight * max(limits.every[k, j] - limits.beyond[k, j], np.float32(0))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _pour(pixels: Singles, line: int, out: Singles) -> None:
    """Add pixels (1, W) to row `line` of out (H, W C), each to its C channels."""
    k, channels = np.uint64(line), np.uint64(out.shape[1] // pixels.shape[1])
    for j in range(np.uint64(0), np.uint64(pixels.shape[1])):
        for c in range(channels):
            out[k, j * channels + c] += pixels[np.uint64(0), j]


@njit(cache=True, nogil=True, error_model="numpy")
def _mend_edges(
    first: Singles,
    last: Singles,
    limits: Limits,
    among: EdgePixels,
    line: int,
    part: int,
    step: int,
    weights: tuple[np.float32, np.float32],
    out: Singles,
    row: int,
) -> None:
    """In the edge pixels of a camera row, put the mean over a row of rays in the place of the one through the centre.

    part: which row of rays; weights: of the light between the profiles, and of all.
    """
    for e in range(among.first[line], among.first[line + 1]):
        j = among.column[e]
        c = j // step
        x = np.float32((j - c * step + 0.5) / step)
        every, zero = limits.every[line, j], np.float32(0)
        near = first[c] + x * (first[c + 1] - first[c])
        far = min(last[c] + x * (last[c + 1] - last[c]), every)
        rays = among.beyond.shape[2]
        for i in range(rays + 1):
            # The rays add their share, the centre takes back its own.
            beyond = among.beyond[e, part, i] if i < rays else limits.beyond[line, j]
            light = weights[0] * max(far - max(near, beyond), zero) + weights[1] * max(every - beyond, zero)
            out[row, j] += light / np.float32(rays) if i < rays else -light


@njit(cache=True, nogil=True, error_model="numpy")
def add_gate(
    table: AirTable,
    raster: ProjectorRows,
    edges: RowEdges,
    limits: Limits,
    among: EdgePixels,
    samples: int,
    room: Profiles,
    out: Singles,
) -> None:
    """Add what a gate records to out (H, W C), pixels of C equal channels; each row is the mean over `samples` rows of
    rays, of which those through edge pixels have their own surfaces."""
    single = out.shape[1] == limits.every.shape[1]
    target = out if single else room.pixels
    for k in range(out.shape[0]):
        part, whole = edges.part[k] / np.float32(samples), edges.whole[k] / np.float32(samples)
        if part == 0 and whole == 0:
            continue
        row = k if single else 0
        if not single:
            room.pixels[:] = 0
        for i in range(samples):
            if whole != 0:
                _add_every(limits, k, whole, target, row)
            if part != 0:
                _fill_profiles(table, raster, edges, k, (i + 0.5) / samples, room)
                _add_between(room, limits, k, table.step, part, target, row)
            if among.column.shape[0] > 0:
                _mend_edges(room.first, room.last, limits, among, k, i, table.step, (part, whole), target, row)
        if not single:
            _pour(room.pixels, k, out)
