"""Side by side: every pixel of every picture, a name above each, and an animation that is exactly that."""

import numpy as np

from harness.viewer.film.panels import GREY, HEADER, MARGIN, side_by_side, size_of


def picture(seed: int, height: int = 9, width: int = 120) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, size=(height, width, 3), dtype=np.uint8)


def test_every_pixel_is_where_it_belongs() -> None:
    pictures = {"nerf": picture(0), "qnerf": picture(1), "ground truth": picture(2)}
    sheet = side_by_side(pictures)
    width, height = size_of(3, 120, 9)
    assert (width, height) == (3 * 240 + 4 * MARGIN, HEADER + 18 + MARGIN)
    assert sheet.shape == (height, width, 3)
    assert sheet.dtype == np.uint8
    for number, expected in enumerate(pictures.values()):
        left = MARGIN + number * (240 + MARGIN)
        panel = sheet[HEADER : HEADER + 18, left : left + 240]
        for row in (0, 1):
            for column in (0, 1):
                np.testing.assert_array_equal(panel[row::2, column::2], expected)
        header = sheet[:HEADER, left : left + 240]
        assert header.min() < 60, "letters"
        assert (header == GREY).mean() > 0.8
    assert (sheet[:, :MARGIN] == GREY).all()
    assert (sheet[-MARGIN:] == GREY).all()
