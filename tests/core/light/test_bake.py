"""Indirect light: what paths bring, against an independent renderer and against what must hold of itself."""

from __future__ import annotations

import numpy as np
import pytest

from references import block_reference, direct_images
from rigs import check_rig
from slopegate.core.gating.gate import row_windows
from slopegate.core.light.bake import Bake, BakeSettings
from slopegate.core.light.indirect import Indirect
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Mesh, Scene, Sphere

RIG = check_rig(80)
CORNER = np.array([[-1, -1, 1.5], [1, -1, 1.5], [1, 1, 1.5], [-1, 1, 1.5], [-1, 0.2, 0.5], [1, 0.2, 0.5]])
ROOM = Scene(
    "wall and floor",
    objects=(
        Mesh("wall", CORNER, np.array([[0, 1, 2], [0, 2, 3]], np.int32)),
        Mesh("floor", CORNER, np.array([[3, 2, 5], [3, 5, 4]], np.int32), (0.5, 0.5, 0.5)),
        Sphere("ball", (0.0, -0.05, 1.2), 0.1, (0.7, 0.7, 0.7)),
    ),
)


@pytest.mark.parametrize("name", ["cornell_global", "three_planes_global"])
def test_agrees_with_the_independent_renderer(name: str) -> None:
    reference = block_reference(name)
    bake = Bake(reference.rig, reference.scene, BakeSettings(max_order=reference.max_order))
    for half in (0, 1):
        bake.trace(half, 64)
    part = Indirect(reference.rig, bake.picture, "mono")
    part.show(bake.snapshot())
    ours = direct_images(reference, 2).astype(np.float32)
    for image, windows in zip(ours, reference.windows, strict=True):
        part.add(windows, image)
    mean, error = reference.misses(ours.astype(np.float64)).T
    assert np.abs(mean).max() < 0.01
    # Rays for the direct part are few here: they are most of the error of thin gates.
    assert error.max() < 0.03
    assert error[-1] < 0.02


def test_equal_seeds_give_equal_tables_and_others_do_not() -> None:
    tables = []
    for seed in (1, 1, 2):
        bake = Bake(RIG, ROOM, BakeSettings(seed=seed))
        bake.trace(0, 4)
        tables.append(bake.snapshot().matt)
    assert np.array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


def test_a_stopped_pass_leaves_the_bake_as_it_was() -> None:
    bake = Bake(RIG, ROOM)
    bake.trace(0, 4)
    before = bake.snapshot()
    shares: list[float] = []
    with pytest.raises(Cancelled):
        bake.trace(0, 256, lambda share: (shares.append(share), share < 0.5)[1])
    assert max(shares) >= 0.5
    after = bake.snapshot()
    assert np.array_equal(before.matt, after.matt)
    assert np.array_equal(before.paths, after.paths)
    whole = Bake(RIG, ROOM)
    whole.trace(0, 4)
    whole.trace(0, 256)
    bake.trace(0, 256)
    assert np.array_equal(bake.snapshot().matt, whole.snapshot().matt)


def test_light_that_turns_once_is_not_in_it() -> None:
    bake = Bake(RIG, ROOM, BakeSettings(max_order=1))
    bake.trace(0, 4)
    assert not bake.snapshot().matt.any()


def test_a_lone_convex_object_has_no_indirect_light() -> None:
    bake = Bake(RIG, Scene("ball", objects=(Sphere("ball", (0.0, 0.0, 1.0), 0.2),)))
    bake.trace(0, 16)
    assert bake.snapshot().paths.sum() > 0
    assert not bake.snapshot().matt.any()


def test_a_gate_and_its_complement_add_up() -> None:
    bake = Bake(RIG, ROOM)
    bake.trace(0, 16)
    part = Indirect(RIG, bake.picture, "mono")
    part.show(bake.snapshot())
    line = RIG.camera.shutter.line.nearest(50.0)
    period = RIG.projector.period_us
    thin, rest, whole = (
        row_windows(RIG, gate(line, delay, exposure))
        for delay, exposure in ((2000.0, 3000.0), (2000.0 + period / 2, period - 3000.0), (0.0, period))
    )
    shape = RIG.camera.lens.height, RIG.camera.lens.width
    images = [np.zeros(shape, np.float32) for _ in range(2)]
    part.add(thin, images[0])
    assert images[0].sum() > 0
    part.add(rest, images[0])
    part.add(whole, images[1])
    np.testing.assert_allclose(images[0], images[1], rtol=2e-5, atol=1e-6)


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="pitch_px is 0"):
        BakeSettings(pitch_px=0)
    with pytest.raises(InputError, match="max_order is 0"):
        BakeSettings(max_order=0)
    with pytest.raises(InputError, match="each is 3"):
        Bake(RIG, ROOM).trace(0, 3)


def test_without_smoothing_the_same_light_is_there_and_more_noise() -> None:
    """Smoothing moves no light over the picture: the mean stays, what differs from cell to cell falls."""
    bake = Bake(RIG, ROOM, BakeSettings(bands=8))
    bake.trace(0, 4)
    bake.trace(1, 4)
    lit = row_windows(RIG, gate(10.0, 0.0, RIG.projector.period_us))
    images = []
    for radius in (0, 2):
        part = Indirect(RIG, bake.picture, "mono", radius)
        part.show(bake.snapshot())
        out = np.zeros((RIG.camera.lens.height, RIG.camera.lens.width), np.float32)
        part.add(lit, out)
        images.append(out)
    raw, smoothed = images
    assert smoothed.mean() == pytest.approx(raw.mean(), rel=0.02)
    assert np.abs(np.diff(smoothed, axis=1)).mean() < 0.7 * np.abs(np.diff(raw, axis=1)).mean()
