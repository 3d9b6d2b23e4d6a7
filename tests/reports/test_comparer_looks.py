"""How the picture comparer looks and reads in a real browser: any width, light and dark, any name, by keys alone."""

import pytest

from tests.reports.browsing import until
from tests.reports.comparer_page import Packed, data_of, write_comparer_page
from tests.reports.comparer_view import ready, settle

pytestmark = pytest.mark.slow

HOSTILE = ("<img src=x onerror=alert(1)>", "</script><b>", "truth", "a" * 90)


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("looks") / "page.html"
    return write_comparer_page(path, data_of(packed, 24), packed).as_uri()


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("hostile") / "page.html"
    data = data_of(packed, 12, ("<svg onload=alert(2)>", "__proto__ & Söhne"), HOSTILE)
    data["left_out"] = ["<script>alert(3)</script> was left out."]
    return write_comparer_page(path, data, packed).as_uri()


def test_names_are_text_and_never_markup(browser, hostile):
    view, noise = ready(browser, hostile, "at=pictures&compare.mode=wipe&compare.a=method+truth")
    assert view.locator("figcaption .who").all_inner_texts()[0] == "truth"
    view.locator(".stage").focus()
    view.keyboard.press("s")
    settle(view)
    assert view.locator("figcaption .who").all_inner_texts() == ["ground truth", *HOSTILE]
    assert view.locator("#comparer :is(img, svg, script, figcaption b)").count() == 0
    assert "<script>alert(3)</script> was left out." in view.inner_text(".notes")
    assert noise == []


def test_all_of_it_has_names_and_is_reached_by_keys(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.mode=wipe&compare.map=signed")
    nameless = """[...document.querySelectorAll('#comparer :is(button, select, input, canvas, [role])')]
        .filter(one => !(one.ariaLabel || one.labels?.length || one.textContent.trim() || one.role === 'status'))"""
    assert view.evaluate(f"{nameless}.map(one => one.outerHTML)") == []
    view.evaluate("document.activeElement.blur()")
    reached = []
    for _ in range(60):
        view.keyboard.press("Tab")
        reached.append(
            view.evaluate("""(() => {
            const one = document.activeElement, style = getComputedStyle(one);
            return [one.ariaLabel || one.textContent, style.outlineStyle !== 'none' && style.outlineWidth !== '0px'];
        })()""")
        )
        if reached[-1][0] == "Numbers of a pixel":
            break
    names = [name for name, _ in reached]
    for name in (
        "Scene",
        "Wipe",
        "A",
        "Signed error",
        "Checkpoint",
        "Exposure",
        "Range of colours",
        "Where A ends and B begins",
    ):
        assert name in names, name
    assert [name for name, seen in reached if not seen] == []
    view.keyboard.press("?")
    assert view.get_by_role("dialog").is_visible()
    view.keyboard.press("Escape")
    until(view, "!document.querySelector('dialog').open")
    assert noise == []
