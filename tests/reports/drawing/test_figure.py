"""A drawing in a page with other drawings."""

import re

from reports.drawing.figure import svg
from reports.drawing.palette import KNOWN
from reports.drawing.traces import Panel, Trace

BLUE = KNOWN["nerf"].light


def test_svg_is_fit_for_a_page_with_others():
    trace = Trace("a", BLUE, "line", (1.0, 2.0), (0.001, 0.002))
    panel = Panel("t", "x", "<\"&'>", (trace,), 'says "<b>"', rows=())
    text = str(svg(panel, "one-1"))
    assert text.startswith('<svg class="plot" viewBox=')
    assert 'aria-label="says &#34;&lt;b&gt;&#34;"' in text
    assert "&lt;" in text
    assert BLUE not in text
    assert "var(--nerf)" in text
    assert "0.001" in text, "numbers in text must not be shortened as coordinates are"
    assert "<style" not in text
    assert "xlink" not in text
    assert "http" not in text
    ids = re.findall(r' id="([^"]+)"', text)
    assert ids
    assert all(name.startswith("one-1-") for name in ids)
    assert len(ids) == len(set(ids))
