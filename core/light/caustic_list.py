"""Caustics under patterns: a list of where particles came from and where they lie, in place of a table.

What glass gathers comes from few places of the projector, so the pattern is looked up at each particle's own pixel. On
the camera's side they are kept in cells as fine as those of a bake without columns, and in bands of projector rows.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.light.baked import Baked, BakeSettings
from slopegate.core.light.caustics import leave, tangent_areas
from slopegate.core.light.cells import make_picture
from slopegate.core.light.kernels_indirect import CellPass, CellSums, cell_pass
from slopegate.core.light.spreading import SubPixels, make_spread
from slopegate.core.light.surfaces import Guides
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig

_BANDS: Final = 72


class ListedCaustics:
    """The list of a bake over a rig's picture."""

    def __init__(self, rig: Rig, guides: Guides, baked: Baked) -> None:
        """guides: what the camera sees."""
        lens, self._rows = rig.camera.lens, rig.projector.lens.height
        self._picture = make_picture(rig, guides, BakeSettings().pitch_for(rig))
        grid = self._picture.grid
        all_of_it = SubPixels(self._picture.view, np.ones((lens.height, lens.width), np.float32))
        self._spread = make_spread(grid, self._picture.cells, rig.camera_centre_m, [all_of_it])
        # Sorted, so that those of one cell and row are added up one after the other.
        home = self._picture.view.home[baked.caustic_places[:, 0]]
        order = np.lexsort((baked.caustic_places[:, 1], home))
        places, self._home = baked.caustic_places[order], home[order]
        self._row, self._pixels = places[:, 1].copy(), places[:, 1] * rig.projector.lens.width + places[:, 2]
        area = tangent_areas(rig, self._picture)[self._home] * int(baked.caustic_count.sum())
        self._light = (baked.caustic_light[order] / np.maximum(area, 1e-30)[:, None]).astype(np.float32)

    def lit_with(self, pattern: Singles | None, tint: Singles) -> CellPass:
        """What a pattern leaves of them, for pixels that multiply light by `tint` (`indirect.tint_of`)."""
        grid, light = self._picture.grid, self._light
        if pattern is not None:
            light = light * np.take(pattern, self._pixels)[:, None]
        sums = np.zeros((grid.rows, _BANDS + 1, light.shape[1], grid.columns), np.float32)
        leave(self._home, self._row, self._rows, light, sums[:, 1:])
        np.cumsum(sums, axis=1, out=sums)
        return cell_pass(CellSums(sums, sums[:, :0]), tint, self._spread, grid)
