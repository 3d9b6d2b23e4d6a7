"""Serving in sentences: for one and for many, what is missed in the same tone; who is first, and where it loses."""

from dataclasses import replace

import pytest

from harness.records.serving_record import Anytime
from reports.studies.serving_said import At, averaged, earlier, first, mean_error
from tests.reports.fake_serving import (
    fake_attention,
    fake_curve,
)


def at(seconds, spread=1.0):
    return At(seconds, seconds / spread, seconds * spread)


def test_races_compare_orders():
    assert first({"attention": at(1.0), "raster": at(2.0), "spread": None}) == "attention"
    assert first({"attention": at(1.0), "raster": at(2.0, 2.0)}) is None
    assert first({"attention": at(1.0), "raster": at(1.0)}) is None
    assert first({"attention": None, "raster": None}) is None
    assert first({"attention": None}) is None
    assert earlier({"attention": at(1.0), "raster": None}, "attention", "raster")
    assert not earlier({"attention": None, "raster": None}, "attention", "raster")
    assert not earlier({"attention": at(1.0), "raster": at(1.0)}, "attention", "raster")
    assert not earlier({"attention": at(1.0, 1.5), "raster": at(2.0, 1.5)}, "attention", "raster")
    assert earlier({"attention": at(1.0, 1.3), "raster": at(2.0, 1.3)}, "attention", "raster")


def test_an_error_averaged_over_time_is_that_of_steps():
    ones, total = [1.0] * 3, (4.0, 4.0)
    curve = Anytime("chair", "nerf", "point", "raster", 1, [1.0, 2.0, 4.0], ones, total, ones, [8.0, 2.0, 0.0], ones)
    assert mean_error(curve, 4.0, "hardest") == pytest.approx((8.0 + 2 * 2.0) / 3)
    assert mean_error(curve, 7.0, "hardest") == pytest.approx((8.0 + 2 * 2.0) / 6)
    assert mean_error(curve, 3.0, "hardest") == pytest.approx((8.0 + 2.0) / 2)
    assert mean_error(curve, 4.0, "whole") == pytest.approx(1.0)
    assert mean_error(curve, 1.0, "whole") is None


def test_averages_over_time_are_ratios():
    alike = {"seconds": [0.1 * k for k in range(26)], "rmse_hardest": [0.1] * 26, "rmse_whole": [0.2] * 26}
    curves = [replace(fake_curve("chair", "point", order, 1.0), **alike) for order in ("attention", "raster")]
    same = fake_attention(curves=curves)
    (said,) = averaged(same)
    assert (
        "against raster order, the error of the whole picture is 1.00 times as large, that of the hardest quarter 1.00 "
        "times" in said
    )
    assert "spread" not in said
    assert averaged(fake_attention(curves=[])) == []
