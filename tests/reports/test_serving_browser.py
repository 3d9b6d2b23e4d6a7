"""What serving was measured to do in a real browser: chosen without a script, readable in the dark and on a phone."""

import pytest

from reports.data.beside import Beside
from reports.data.load import read_records
from reports.run.run_page import write_page
from tests.reports.browsing import opened
from tests.reports.exploring import rows_of, saved
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_serving, write_fake_serving

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_run(tmp_path_factory.mktemp("serving") / "run", ("chair",), pictures=False)
    write_fake_serving(out)
    write_page(read_records(out), out / "report.html", Beside(serving=fake_serving()))
    return (out / "report.html").as_uri()


def shown(view) -> list[str]:
    return view.evaluate(
        "[...document.querySelectorAll('.measured')].filter(one => one.offsetHeight).map(one => one.className)"
    )


def test_one_map_of_attention_is_seen_and_the_reader_chooses_which(browser, address):
    view, noise = opened(browser, address)
    assert shown(view) == ["measured map0-served0"]
    view.get_by_text("gradients of the coarse frame", exact=True).first.click()
    assert shown(view) == ["measured map1-served0"]
    view.keyboard.press("ArrowLeft")
    assert shown(view) == ["measured map0-served0"], "by keyboard as well"
    assert noise == []


def test_a_drawing_of_camera_paths_is_saved_with_the_rows_in_sight_alone(browser, address):
    view, noise = opened(browser, address)
    tools = view.locator("#cache .tools", has=view.get_by_role("button", name="Save the figure: Where the views"))
    names = view.locator(".uses tbody th").evaluate_all("all => all.map(one => one.firstChild.textContent.trim())")
    assert len(set(names)) == 2
    for left in (2, 1, 0):
        view.evaluate(
            """left => [...document.querySelector('.uses').tBodies[0].rows]
                .forEach((row, place) => row.classList.toggle('unmatched', place >= left))""",
            left,
        )
        drawing = saved(view, tools, "SVG")
        assert [name for name in names if f">{name[:8]}" in drawing] == names[:left]
        assert len(rows_of(saved(view, tools, "CSV"))) == left
    assert [one for one in noise if not one.startswith("blob:")] == []
