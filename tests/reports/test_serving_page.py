"""The sections about serving: told from figures, drawn to scale, escaped, small, and silent where nothing is."""

import html
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from harness.serving_record import (
    Anytime,
    AttentionRecord,
    CacheRecord,
    FirstFrame,
    PhiCheck,
)
from reports.beside import Beside
from reports.load import read_records
from reports.page import page
from reports.serving_attention import attention
from reports.serving_cache import cache
from reports.serving_curves import INVISIBLE, anytime_panels
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import (
    ORDERS,
    fake_attention,
    fake_cache,
    fake_curve,
    fake_serving,
    reaching,
    reachings,
    write_fake_serving,
)
from tests.reports.test_page import HOSTILE, Outline, foreign_scripts


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    run = write_fake_run(tmp_path_factory.mktemp("served") / "run", ("chair",), seeds=2, pictures=False)
    return write_fake_serving(run)


@pytest.fixture(scope="module")
def text(out) -> str:
    return page(read_records(out), Beside(serving=fake_serving()))


def plain(words: str) -> str:
    return words.replace("\u202f", " ")


def seen(text: str, section: str) -> str:
    """What a reader reads of a section."""
    body = text[text.index(f'<section id="{section}">') :]
    body = body[: body.index("</section>")]
    return plain(re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", body))))


def test_both_sections_are_there_well_formed_and_fetch_nothing(text):
    outline = Outline(text)
    assert len(outline.ids) == len(set(outline.ids))
    assert {"#cache", "#attention"} <= set(outline.links)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert [link for link in outline.links if not link.startswith(("#", "data:"))] == []
    assert foreign_scripts(text) == []


def test_the_cache_is_told_from_its_figures(text):
    said = seen(text, "cache")
    for words in ("A hit in memory, of a method that is no longer trained, is 2 812 to 5 357 times faster than "
                  "rendering (target 1 000: met). A hit in memory, where the weights are hashed at every call, is 75.0 "
                  "to 125 times faster than rendering (target 1 000: missed). A hit on disk, with the file in the "
                  "operating system’s memory, is 30.0 to 53.6 times faster than rendering (target 50: missed in 1 of 2 "
                  "cases, open in 1: the spread reaches across). A hit on disk, with the file dropped from the "
                  "operating system’s memory, is 18.0 to 30.0 times faster than rendering (target 50: missed).",
                  "mean over 3 seeds 40.0 %, 15.0 to 60.0 %",
                  "A view of 40 × 40 px takes 32.0 kB in memory and 21.4 kB on disk.",
                  "14.0 µs 10.8 µs to 18.2 µs", "memory (level 0) 20 · memory (level 1) 20 · rendered 20", "66.7 %",
                  "2.80 s (3.0 times as long)", "would have returned 8 stale pictures of 12, off by 0.0123 to 0.141",
                  "ours missed each of them"):  # fmt: skip
        assert words in said, words


def test_attention_is_told_from_its_figures(text):
    said = seen(text, "attention")
    for words in ("the order by attention is first in 0 of 6 cases of scene and map",
                  "against raster order: earlier in 0, later in 6 (all of them)",
                  "the coarse frame is most wrong, which no map chooses, attention is first in 6 of 6 cases",
                  "that is attended most it is first in 5 of 6 cases: before other orders of regions by construction",
                  "with those of finding out where samples belong (6 % of them)",
                  "that is 1.10 times as large in the whole picture and 0.90 times in what is attended",
                  "With as many samples it is 0.80 times as large in the whole picture and 0.60 times in what is",
                  "it takes 2.00 times the evaluations",
                  "priorities sum to 1.618, not to 1", "Of 18 maps looked at, leaving φ out changed the order in 0",
                  "is computed after 310 ms (target 0.5 s: met), coarse: nerf a ray for each 2 × 2 px at 24.1 dB",
                  "qnerf is not rendered by regions: its density depends on which points share a call. By regions its "
                  "picture would be off by 0.0131 on chair", "24.6 dB", "a point of interest",
                  "camera paths were followed with nerf alone", "2 threads"):  # fmt: skip
        assert words in said, words


def test_bars_are_as_long_as_their_views(text):
    widths = [float(one) for one in re.findall(r'<i class="(?:level-\d|render)" style="width: ([\d.]+)%"', text)]
    assert sum(widths) == pytest.approx(200, abs=0.01)
    assert widths == pytest.approx([100 / 3] * 3 + [7.5, 15, 22.5, 55], abs=0.01)


@pytest.mark.slow
def test_nothing_rough_is_shown_without_a_warning(out):
    records = read_records(out)
    for settings, words in (({"quick": True}, "Measured too quickly."), ({"complete": False}, "Not everything was")):
        body = page(records, Beside(serving=fake_serving(settings=settings)))
        assert words in seen(body, "cache")
        assert words in seen(body, "attention")
    failed = fake_serving(settings={"complete": False}, failed=["view cache"])
    assert "Failed: view cache." in seen(page(records, Beside(serving=failed)), "attention")
    whole = page(records, Beside(serving=fake_serving()))
    assert "Measured too quickly." not in whole
    assert "Not everything was measured" not in whole


@pytest.mark.slow
def test_each_part_may_be_missing(out):
    records = read_records(out)
    bare = page(records, Beside(serving=fake_serving(attention=None)))
    assert "The viewer’s first frame" in seen(bare, "attention")
    assert "camera paths were followed" in seen(bare, "attention")
    alone = page(records, Beside(serving=fake_serving(attention=None, first_frame=None, left_out=[])))
    assert 'id="attention"' not in alone
    assert "measured in 3 min 23 s" in seen(alone, "cache")
    only = page(records, Beside(serving=fake_serving(cache=None)))
    assert 'id="cache"' not in only
    nothing = fake_serving(cache=None, attention=None, first_frame=None, left_out=["no method: no checkpoints"])
    assert "no method: no checkpoints" in seen(page(records, Beside(serving=nothing)), "attention")


def test_empty_records_have_sections():
    empty = AttentionRecord(40, 40, 8, 512, [], [], [], [], PhiCheck(0.0, 0, 0, 0))
    shown = attention(fake_serving(attention=empty, first_frame=None), Path("nowhere"))
    assert (shown.answer, shown.sentences, shown.choices, shown.strips) == ("No order was timed.", [], [], [])
    bare = cache(CacheRecord(40, 40, [], [], [], 0, 0), [])
    assert (bare.answer, bare.plots, bare.confused, bare.confusions) == ("No hit was timed.", [], "", None)


def test_what_is_invisible_stands_at_the_foot():
    curve = fake_curve("chair", "point", "attention", 1.0)
    goal = reaching(curve, "attended", 0.09)
    (panel,) = anytime_panels([curve], [goal, reaching(curve, "whole", 0.07)], "attended")
    line = panel.traces[0]
    assert (min(line.y), panel.zero_at) == (INVISIBLE, INVISIBLE)
    assert line.x[0] == curve.seconds[0]
    assert line.x[-1] == curve.seconds[-1]
    marks = [trace for trace in panel.traces if trace.kind == "mark"]
    assert [(trace.x, trace.y) for trace in marks] == [((goal.seconds,), (goal.error,))]
    (above,) = anytime_panels([replace(curve, rmse_whole=[0.1 + 0.001 * k for k in range(26)])], [], "whole")
    assert above.zero_at is None


def test_a_long_curve_is_thinned_and_keeps_its_ends_and_its_fall():
    many = 1000
    error = [0.1 if place < 777 else 0.0 for place in range(many)]
    curve = Anytime("chair", "nerf", "point", "raster", 1, [0.001 * k for k in range(many)],
                    [k / many for k in range(many)], (0.9, 1.0), error, error, error)  # fmt: skip
    line = anytime_panels([curve], [], "whole")[0].traces[0]
    assert len(line.x) < 170
    assert (line.x[0], line.x[-1]) == (0.0, pytest.approx(0.999))
    fall = next(at for at, value in zip(line.x, line.y, strict=True) if value == INVISIBLE)
    assert fall == pytest.approx(0.777, abs=0.999 / 80)


def test_hostile_words_stay_words(out):
    def spoiled(one, **also):
        words = {name: HOSTILE for name, value in one.__dict__.items() if isinstance(value, str)}
        kept = {name: getattr(one, name) for name in ("source", "order", "way", "image") if hasattr(one, name)}
        return replace(one, **{**words, **kept, **also})

    served, looked = fake_cache(), fake_attention()
    curves = [spoiled(one) for one in looked.curves[:3]]
    bad_cache = replace(
        served,
        latencies=[spoiled(one) for one in served.latencies[:4]],
        paths=[spoiled(one) for one in served.paths],
        confusions=[replace(spoiled(one), missed=0) for one in served.confusions],
    )
    bad = replace(
        looked,
        curves=curves,
        reaching=reachings(curves),
        allocations=[spoiled(one) for one in looked.allocations[:2]],
        not_by_regions=[spoiled(one) for one in looked.not_by_regions],
        frames=[spoiled(one) for one in looked.frames],
    )
    record = fake_serving(
        cache=bad_cache,
        attention=bad,
        left_out=[HOSTILE],
        first_frame=FirstFrame(HOSTILE, [HOSTILE], 1, 1, 0.1, 0.1, 1, [2], [20.0]),
        settings={"attention": {HOSTILE: HOSTILE}, "seed": HOSTILE, "width": HOSTILE, "threads": HOSTILE},
    )
    text = page(read_records(out), Beside(serving=record))
    assert foreign_scripts(text) == []
    assert "alert('x')" in html.unescape(text)


def test_kinds_of_records_are_all_shown():
    """A new list in a record wants a place on the page, and this test a new line."""
    assert set(CacheRecord.__dataclass_fields__) == {
        "width", "height", "latencies", "paths", "confusions", "memory_bytes_per_view", "disk_bytes_per_view",
        "target_memory", "target_disk",
    }  # fmt: skip
    assert set(AttentionRecord.__dataclass_fields__) == {
        "width", "height", "tile", "reference_bins", "curves", "reaching", "allocations", "not_by_regions", "phi",
        "frames",
    }  # fmt: skip


def test_the_sections_stay_small(out):
    records = read_records(out)
    maps = [fake_curve(scene, f"map {kind}", order, 1.0) for scene in ("chair", "drums", "lego") for kind in range(5)
            for order in ORDERS]  # fmt: skip
    long = [
        replace(one, seconds=[0.001 * k for k in range(101)], share=[k / 100 for k in range(101)],
                rmse_attended=[0.1 * math.exp(-0.1 * k) for k in range(101)],
                rmse_hardest=[0.1 * math.exp(-0.08 * k) for k in range(101)],
                rmse_whole=[0.1 * math.exp(-0.05 * k) for k in range(101)])
        for one in maps
    ]  # fmt: skip
    record = fake_serving(attention=fake_attention(curves=long, reaching=reachings(long)))
    assert len(page(records, Beside(serving=record))) - len(page(records)) < 1_600_000  # drawings and their numbers
