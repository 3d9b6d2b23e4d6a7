"""The sections about serving: told from figures, drawn to scale, escaped, small, and silent where nothing is."""

import html
import re
from dataclasses import replace

import pytest

from harness.records.serving_record import FirstFrame
from reports.data.beside import Beside
from reports.data.load import read_records
from reports.run.run_page import page
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import (
    fake_attention,
    fake_cache,
    fake_serving,
    reachings,
    write_fake_serving,
)
from tests.reports.run.test_page import HOSTILE, foreign_scripts


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
