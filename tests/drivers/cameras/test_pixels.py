from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.drivers.cameras.pixels import PixelLayout, best_layout, layout_of, unpack
from slopegate.drivers.contract.camera import CameraError

NAMES = [
    f"{kind}{suffix}"
    for kind in ("Mono", "BayerRG", "BayerGR", "BayerGB", "BayerBG")
    for suffix in ("8", "10", "12", "14", "16", "10p", "12p", "14p", "10Packed", "12Packed")
]


def pack(counts: list[int], layout: PixelLayout) -> bytes:
    """By the letter of the standards, on whole numbers of any length."""
    if layout.packing == "lsb":
        stream = sum(count << (k * layout.bits) for k, count in enumerate(counts))
        return stream.to_bytes(layout.bytes_of(len(counts)), "little")
    if layout.packing == "none":
        return b"".join(count.to_bytes(1 if layout.bits == 8 else 2, "little") for count in counts)
    low = layout.bits - 8
    out = bytearray(layout.bytes_of(len(counts)))
    for k, count in enumerate(counts):
        third = k // 2 * 3
        out[third + (2 if k % 2 else 0)] = count >> low
        out[third + 1] |= (count & (2**low - 1)) << (4 if k % 2 else 0)
    return bytes(out)


@given(st.sampled_from(NAMES), st.integers(1, 5), st.integers(1, 9), st.integers(0, 3), st.data())
def test_every_count_comes_out_of_every_layout(
    name: str, rows: int, columns: int, spare: int, data: st.DataObject
) -> None:
    layout = layout_of(name)
    assert layout is not None
    size = rows * columns
    counts = data.draw(st.lists(st.integers(0, layout.max_count), min_size=size, max_size=size))
    # an odd place in memory, and what follows the image in the buffer
    packed = np.frombuffer(b"\x55" + pack(counts, layout) + b"\xaa" * spare, np.uint8)[1:]
    out = np.full((rows, columns), 0xFFFF, np.uint16)
    unpack(packed, layout, out)
    np.testing.assert_array_equal(out.ravel(), counts)


@pytest.mark.parametrize("name", ["Mono8", "Mono16", "Mono12p", "Mono12Packed"])
def test_an_image_cut_short_is_refused(name: str) -> None:
    layout = layout_of(name)
    assert layout is not None
    out = np.full((4, 6), 7, np.uint16)
    with pytest.raises(CameraError, match="needs"):
        unpack(np.zeros(layout.bytes_of(24) - 1, np.uint8), layout, out)
    assert (out == 7).all()


@pytest.mark.parametrize("name", ["RGB8", "Mono1p", "Mono8p", "Mono16p", "YUV422_8", "Coord3D_ABC32f", "", "mono8"])
def test_unknown_formats_are_not_guessed(name: str) -> None:
    assert layout_of(name) is None


def test_names_become_the_formats_of_frames() -> None:
    kinds = {name: layout.pixel_format for name in NAMES if (layout := layout_of(name)) is not None}
    assert kinds["Mono12Packed"] == "mono12"
    assert kinds["BayerGB10p"] == "bayer_gb10"
    assert len(kinds) == len(NAMES)


@pytest.mark.parametrize(
    ("names", "present", "best"),
    [
        (["Mono8", "Mono12", "Mono12p", "Mono10"], "Mono8", "Mono12p"),
        (["Mono8", "Mono16"], "Mono8", "Mono16"),
        (["Mono8", "BayerRG12", "BayerRG8"], "BayerRG8", "BayerRG12"),
        (["Mono8", "BayerRG12", "RGB8"], "RGB8", "Mono8"),
        (["BayerGR8", "RGB8"], "RGB8", "BayerGR8"),
        (["RGB8", "YUV8"], "RGB8", None),
    ],
)
def test_the_deepest_of_the_present_kind_is_chosen(names: list[str], present: str, best: str | None) -> None:
    layout = best_layout(names, present)
    assert (layout.name if layout else None) == best
