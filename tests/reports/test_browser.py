"""The page in a real browser: no errors, no requests, readable in the dark and on a phone."""

import numpy as np
import pytest

from reports.data.kept_pictures import kept
from reports.data.load import read_records
from reports.run.run_page import write_page
from tests.reports.browsing import opened, until
from tests.reports.comparer_view import bytes_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(pictured, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(read_records(pictured), path)
    return path.as_uri()


def test_the_runs_behind_a_figure_are_seen(browser, address, pictured):
    view, noise = opened(browser, f"{address}#runs.open=1&scene=drums&method=nerf&seed=1")
    noise.remove(address)
    until(view, "document.querySelectorAll('#runs canvas[data-drawn]').length === 2")
    drums = kept(read_records(pictured), "drums")
    seen = view.evaluate("""[...document.querySelectorAll('#runs canvas')].map(one =>
        [...one.getContext('2d').getImageData(13, 17, 1, 1).data].slice(0, 3))""")
    last = drums.renders["nerf", 1][0]
    expected = [np.clip(one.astype(float), 0, 1) for one in (drums.truth["r_12"].display, last.colour)]
    assert (last.view, seen) == ("r_12", [bytes_of(picture, 13, 17) for picture in expected])
    assert view.locator("#runs .thumbnail small").all_inner_texts() == ["ground truth", "step 1600"]
    view.get_by_role("button", name="compare the pictures").click()
    until(view, "location.hash.includes('at=pictures')")
    assert noise == []
