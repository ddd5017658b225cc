"""What stands in place of a picture while there is none."""

from __future__ import annotations

import numpy as np
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.picture_view import PictureView


def colours_of(view: PictureView) -> set[int]:
    image = view.grab().toImage()
    return {image.pixel(x, y) for x in range(image.width()) for y in range(image.height())}


def test_an_empty_picture_says_what_comes_there_until_it_comes(qtbot: QtBot) -> None:
    view = PictureView("A picture")
    qtbot.addWidget(view)
    view.resize(200, 120)
    assert len(colours_of(view)) == 1
    view.say_empty("The picture comes here. Press Acquire to begin.")
    assert len(colours_of(view)) > 1
    view.show_picture(np.zeros((120, 200, 3), np.uint8), (200, 120))
    assert len(colours_of(view)) == 1
    view.show_picture(None)
    assert len(colours_of(view)) > 1
