"""stability.html in a real browser: no noise, readable on a phone and in the dark, no failure out of sight."""

import pytest

from reports.studies.study_page import write_study_page
from tests.reports.browsing import opened, unfold
from tests.reports.fake_stability import fake_stability, write_fake_stability

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_stability(tmp_path_factory.mktemp("stability"))
    return write_study_page(fake_stability(), out).as_uri()


def test_on_a_phone_no_outcome_needs_scrolling_and_the_matrix_names_its_subjects(browser, address):
    view, _ = opened(browser, address, viewport={"width": 390, "height": 800})
    unfold(view)
    tables = "[...document.querySelectorAll('.matrix, .checks .scroll')]"
    over = f"{tables}.filter(one => one.scrollWidth > one.clientWidth).length"
    assert view.evaluate(over) == 0
    named = view.evaluate(
        "[...document.querySelectorAll('.matrix td[data-subject]')].map(o => getComputedStyle(o, '::before').content)"
    )
    assert '"midpoint" " "' in named or '"midpoint "' in named
    assert all(len(name) > 4 for name in named)
