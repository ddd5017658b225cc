"""The paper's figures 15 to 18: light transport by slices acquired on the bench, in small pictures and few blocks.

Figure 13 is in `bench/test_transport.py`. Full sizes are marked slow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from slopegate.app.api import PartName, SliceLight
from slopegate.core.measure.quality import ncc
from slopegate.core.render.coverage import true_alpha
from slopegate.core.transport.keying import clean_plate, grab_cut, hsv_key
from slopegate.core.transport.matte import MatteErrors, matte_errors
from slopegate.drivers.files.images import srgb8
from slopegate.drivers.scenes.scene_files import scene_path
from transport_scenes import acquired, alone, arrow, covered, inside_box, mean_over, small_scene

THINGS = {
    "pepper": ("pepper", "stem", "pepper's post"),
    "card box": ("card box",),
    "ball": ("ball", "ball's post"),
    "board": ("board",),
}
"""Of four_materials, nearest first."""
FRONT = ("grass", "green pepper", "green pepper's stem", "red pepper", "red pepper's stem", "second green pepper",
         "second green pepper's stem", "bench")  # fmt: skip
"""Of green_wall."""


def test_figure_15_each_of_four_materials_has_its_own_colour(tmp_path: Path) -> None:
    opened = small_scene("four_materials", 10)
    found = acquired(opened, tmp_path / "four", 0.68, 1.65, 4, grid="4x2")
    images = [found.relight(alone(4, k, SliceLight())) for k in range(4)]
    for place, (name, parts) in enumerate(THINGS.items()):
        where = covered(opened, *parts)
        shares = np.array([mean_over(image, where) for image in images])
        assert shares[place] / shares.sum() >= 0.99, name
    colours = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)]
    relit = found.relight([SliceLight(colour) for colour in colours])
    expected = sum(np.multiply.outer(image, colour) for image, colour in zip(images, colours, strict=True))
    np.testing.assert_allclose(relit, expected, atol=1e-6)


@dataclass(frozen=True)
class Logo:
    """Figure 16. leak: light in the bottle's pixels in the wall's slice, over the wall's; back: light of the wall in
    the bottle's slice, over the bottle's; likeness: of the logo on the wall to what the scene shows; frames: of the
    slice with the most."""

    leak: float
    back: float
    likeness: float
    frames: int


def logo_on_wall(folder: Path, binning: int, grid: str, parts: tuple[PartName, ...] | None) -> Logo:
    opened = small_scene("logo_wall", binning)
    found = acquired(opened, folder, 0.62, 1.2, 2, grid=grid, codes="adaptive", parts=parts)
    logo, blocks = found.picture(scene_path("logo_wall").with_name("logo.png")), found.folder.grid
    bottle, wall = covered(opened, "bottle", "foil", "label"), covered(opened, "wall")
    in_front, behind = (found.slices[k].total for k in range(2))
    lit = wall & (behind > 0.1 * behind.max())
    relit = found.relight(alone(2, 1, SliceLight(picture=logo)))
    shown = opened.light(found.gates[1], parts=parts, pattern=blocks.spread(blocks.means(logo)))
    return Logo(
        mean_over(behind, bottle) / mean_over(behind, lit),
        mean_over(in_front, lit) / mean_over(in_front, bottle),
        ncc(relit, shown, lit),
        max(sum(stage.frames for stage in record.stages) for record in found.folder.records().values()),
    )


def test_figure_16_a_logo_on_the_wall_spares_the_bottle(tmp_path: Path) -> None:
    found = logo_on_wall(tmp_path / "bottle", 8, "512x512", ("direct",))
    assert found.leak < 0.005
    assert found.back < 0.001
    assert found.likeness > 0.999
    assert found.frames <= 50


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_figure_16_with_all_light_and_in_full_size(tmp_path: Path) -> None:
    found = logo_on_wall(tmp_path / "bottle", 1, "512x512", None)
    assert found.leak < 0.01
    assert found.back < 0.01
    assert found.likeness > 0.99
    assert found.frames <= 2000


def focused(folder: Path, binning: int, grid: str) -> dict[str, float]:
    """Figure 17: light on targets alone. `walls`, `targets`: share of each one's light that is left; `arrow`: likeness
    of an arrow on the far target to the arrow itself."""
    opened = small_scene("fog_targets", binning)
    found = acquired(opened, folder, 0.75, 1.75, 2, grid=grid, codes="adaptive")
    targets = [covered(opened, name) for name in ("near target", "far target")]
    walls = covered(opened, "left wall", "right wall")
    lit = []
    for place, where in enumerate(targets):
        reach = found.dual_image(place, where.astype(np.float32))
        lit.append((reach > 0.2 * np.percentile(reach, 99.9)).astype(np.float32))
    flood = found.relight()
    relit = found.relight([SliceLight(picture=picture) for picture in lit])
    pointing = inside_box(arrow(90, 160), lit[1] > 0)
    seen = opened.buffers
    place = seen.projector_row.astype(int), seen.projector_column.astype(int)
    true = np.where(targets[1], pointing[place], 0.0)
    with_arrow = found.relight(alone(2, 1, SliceLight(picture=pointing)))
    both = targets[0] | targets[1]
    return {
        "walls": mean_over(relit, walls) / mean_over(flood, walls),
        "targets": mean_over(relit, both) / mean_over(flood, both),
        "arrow": ncc(with_arrow, true, targets[1]),
    }


def test_figure_17_side_walls_vanish_and_an_arrow_shows_on_the_target(tmp_path: Path) -> None:
    found = focused(tmp_path / "fog", 16, "32x32")
    assert found["walls"] < 0.06
    assert found["targets"] > 0.7
    assert found["arrow"] > 0.88


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_figure_17_in_blocks_as_fine_as_the_papers(tmp_path: Path) -> None:
    found = focused(tmp_path / "fog", 4, "512x512")
    assert found["walls"] < 0.06
    assert found["targets"] > 0.7
    assert found["arrow"] > 0.95


def mattes(folder: Path, binning: int, grid: str) -> dict[str, MatteErrors]:
    """Figure 18: errors of mattes of green things before a green wall: by slices, and by what one does without."""
    opened = small_scene("green_wall", binning)
    found = opened.acquire_transport(
        folder, opened.plan_lit_slices(2), grid=grid, codes="adaptive", noise=False, pixel_format="bayer_rg12"
    )
    truth = true_alpha(opened.rig, opened.scene, FRONT, 8)
    lit = opened.light(opened.everything_lit, colour=True, parts=("direct",))
    photo = srgb8(lit / np.percentile(lit, 99.5))
    empty = replace(opened.scene, objects=tuple(item for item in opened.scene.objects if item.name not in FRONT))
    plate = replace(opened, scene=empty).light(opened.everything_lit, colour=True, parts=("direct",))
    rows, columns = np.flatnonzero(truth.any(axis=1)), np.flatnonzero(truth.any(axis=0))
    box = int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
    white = float(np.percentile(lit, 99.5))
    return {
        "slices": matte_errors(found.matte((0,)), truth),
        "hsv": matte_errors(hsv_key(photo), truth),
        "grab cut": matte_errors(grab_cut(photo, box), truth),
        "clean plate": matte_errors(clean_plate(lit, plate, 0.02 * white, 0.1 * white), truth),
    }


def test_figure_18_slices_cut_green_things_out_of_green_ones(tmp_path: Path) -> None:
    errors = mattes(tmp_path / "green", 5, "32x32")
    assert errors["hsv"].sad >= 10 * errors["slices"].sad
    assert errors["hsv"].mse >= 10 * errors["slices"].mse
    for name in ("grab cut", "clean plate"):
        assert errors[name].sad > errors["slices"].sad, name


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_figure_18_in_full_size(tmp_path: Path) -> None:
    errors = mattes(tmp_path / "green", 1, "32x32")
    assert errors["hsv"].sad >= 30 * errors["slices"].sad
