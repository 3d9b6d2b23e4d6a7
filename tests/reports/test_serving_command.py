"""python -m reports where there is a serving.json: page, summary, what is published, what is refused."""

import json
import shutil
from dataclasses import replace

import pytest

from harness.records.serving_record import SERVING_FILE, read_serving
from reports.__main__ import main
from reports.data.serving_load import find_serving
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_attention, fake_serving, write_fake_serving
from tests.reports.test_command import BUILD, HEAVY, fresh


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_fake_run(
        tmp_path_factory.mktemp("serving") / "run", ("chair",), seeds=2, pictures=False, with_diverged=False
    )


@pytest.fixture
def out(run, tmp_path):
    """A run with everything beside it, to be changed."""
    return write_fake_serving(shutil.copytree(run, tmp_path / "run"))


def test_what_was_written_is_read(out):
    assert find_serving(out) == fake_serving()


def test_it_stands_in_the_report_and_in_the_summary(out):
    assert main([str(out), "--quiet"]) == 0
    report = (out / "report.html").read_text(encoding="utf-8")
    assert '<section id="cache">' in report
    assert '<section id="attention">' in report
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["schema"] == 1
    assert [one["hit_rate"] for one in summary["cache"]["paths"]] == pytest.approx([40 / 60, 18 / 40])
    assert summary["cache"]["latencies"][1]["source"] == "level 0"
    assert summary["attention"]["first_frame"]["seconds_coarse"] == 0.31
    curves = fake_serving().attention.curves
    assert len(summary["attention"]["curves"]) == len(curves)
    assert summary["attention"]["curves"][1]["rmse_whole"] == pytest.approx(curves[1].rmse_whole, rel=1e-4)
    assert not any("View cache" in one for one in summary["not_tested"])


def test_without_it_the_keys_are_there_and_empty_and_the_remedy_is_named(run, tmp_path):
    out = shutil.copytree(run, tmp_path / "run")
    assert main([str(out), "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["cache"], summary["attention"]) == (None, None)
    assert any("python -m harness study serving OUT" in one for one in summary["not_tested"])
    report = (out / "report.html").read_text(encoding="utf-8")
    assert 'id="cache"' not in report
    assert 'id="attention"' not in report


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": 1}', '{"schema": 99}', '{"schema": 2, "cache": 3}'])
def test_a_damaged_record_gives_2_and_writes_nothing(out, capsys, content):
    (out / SERVING_FILE).write_text(content, encoding="utf-8")
    assert main([str(out)]) == 2
    caught = capsys.readouterr()
    assert caught.err.startswith(str(out / SERVING_FILE))
    assert f"run `python -m harness study serving {out}` again" in caught.err
    assert len(caught.err.splitlines()) == 1
    assert not (out / "report.html").exists()


CURVE, LATENCY, PATH = ["attention", "curves", 0], ["cache", "latencies", 1], ["cache", "paths", 0]
BAD = [
    ([*LATENCY, "seconds"], -1.0, "seconds is -1.0"),
    ([*LATENCY, "seconds"], 1.0, "lies outside of its spread"),
    ([*LATENCY, "ratio"], None, "a hit has a ratio with a spread, rendering has none"),
    ([*LATENCY, "ratio_spread"], [2.0, 1.0], "ratio_spread is [2.0, 1.0]"),
    ([*LATENCY, "source"], "level 1", "latency chair, nerf, level 1 is there twice"),
    ([*LATENCY, "calls"], 0, "calls is 0"),
    ([*PATH, "other_hit_rates"], [0.5, 1.5], "other_hit_rates are [0.5, 1.5]"),
    ([*PATH, "hits", "render"], 21, "60 views, but 61 that came from anywhere"),
    ([*PATH, "hits"], {"level 9": 60}, "hits from 'level 9'"),
    ([*PATH, "hits"], {"render": 70, "level 0": -10}, "60 views, but 60 that"),
    (["cache", "confusions", 0, "stale"], 5, "stale is 5 of 4 views"),
    (["cache", "confusions", 0, "rmse"], -0.1, "rmse is -0.1"),
    (["cache", "memory_bytes_per_view"], -1, "memory_bytes_per_view is -1"),
    ([*CURVE, "share"], [0.5], "26 seconds, 1 share"),
    ([*CURVE, "seconds"], list(range(26, 0, -1)), "seconds run backwards"),
    ([*CURVE, "share", 25], 1.5, "share is 1.5, more than all"),
    ([*CURVE, "rmse_whole", 3], -0.1, "rmse_whole is -0.1"),
    ([*CURVE, "rmse_whole", 3], float("nan"), "JSON is malformed"),
    ([*CURVE, "order"], "raster", "curve chair, nerf, point, raster is there twice"),
    (["attention", "reaching", 0, "share_of_error"], 1.5, "share_of_error is 1.5"),
    (["attention", "reaching", 0, "spread"], None, "there together or not at all"),
    (["attention", "reaching", 0, "spread"], [3.0, 4.0], "lies outside of its spread [3.0, 4.0]"),
    (["attention", "reaching", 0, "error"], -0.1, "error is -0.1"),
    (["attention", "reaching", 0, "measure"], "hardest", "hardest, 0.1 is there twice"),
    ([*CURVE, "total_spread"], [3.0, 4.0], "lies outside of its spread [3.0, 4.0]"),
    (["attention", "allocations", 0, "own"], 1e9, "own is 1000000000.0 of 6400.0 evaluations"),
    (["attention", "allocations", 0, "seconds_spread"], [3.0, 4.0], "lies outside of its spread"),
    (["attention", "allocations", 1, "against"], 8, "allocation chair, nerf, point, even, 8 is there twice"),
    (["first_frame", "strides"], [2], "2 methods, 1 strides, 2 psnr_coarse"),
    (["attention", "allocations", 0, "evaluations"], 0.0, "evaluations is 0.0"),
    (["attention", "allocations", 0, "truth_whole"], -1.0, "truth_whole is -1.0"),
    (["attention", "phi", "orders_changed"], 19, "φ changed 19 orders and 0 allocations of 18 maps"),
    (
        ["attention", "frames", 0, "image"],
        "images/serving/gone.png",
        "'images/serving/gone.png' is missing in records/",
    ),
    (["attention", "frames", 0, "image"], "../serving.json", "'../serving.json' lies outside of records/"),
    (["first_frame", "seconds_coarse"], 2.0, "coarse after 2.0 s, whole after 0.92 s"),
]


def spoil(out, place: list, value) -> None:
    """Writes the record with what lies at `place` replaced."""
    data = json.loads((out / SERVING_FILE).read_text(encoding="utf-8"))
    data.pop("digest", None)
    *way, last = place
    target = data
    for step in way:
        target = target[step]
    target[last] = value
    (out / SERVING_FILE).write_text(json.dumps(data), encoding="utf-8")


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ([*LATENCY, "seconds"], "fast", "got `str` - at `$.cache.latencies[1].seconds`"),
        ([*LATENCY, "source"], "level 3", "Invalid enum value 'level 3'"),
    ],
)
def test_what_is_of_another_type_is_named(out, place, value, said, capsys):
    spoil(out, place, value)
    assert main([str(out)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize(("place", "value", "said"), BAD)
def test_what_no_measurement_gives_is_named(out, capsys, place, value, said):
    spoil(out, place, value)
    assert main([str(out)]) == 2
    caught = capsys.readouterr().err
    assert said in caught
    assert f"run `python -m harness study serving {out}` again" in caught
    assert len(caught.splitlines()) == 1


def test_publishing_writes_the_record_without_pictures_and_curves_and_a_plot(out, tmp_path):
    docs = tmp_path / "docs"
    assert main([str(out), "--quiet", "--publish", str(docs)]) == 0
    published = read_serving(docs / SERVING_FILE)
    assert published == replace(fake_serving(), attention=fake_attention(frames=[], curves=[]))
    plot = (docs / "serving.png").read_bytes()
    assert plot.startswith(b"\x89PNG")
    assert 5_000 < len(plot) < 300_000
    summary = json.loads((docs / "summary.json").read_text(encoding="utf-8"))
    assert summary["cache"]["width"] == 40


@pytest.mark.parametrize(
    ("settings", "said"), [({"quick": True}, "a quick run, too rough to publish"), ({"complete": False}, "not whole")]
)
def test_what_is_rough_or_not_whole_is_not_published(out, tmp_path, capsys, settings, said):
    write_fake_serving(out, fake_serving(settings=settings))
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


@pytest.mark.thorough
@pytest.mark.slow
def test_the_page_is_built_without_torch_and_mitsuba(out, tmp_path):
    done = fresh(f"{BUILD} {HEAVY}", str(out), "--quiet", "--publish", str(tmp_path / "docs"))
    assert done.stderr == ""
    assert done.stdout.splitlines()[1:] == ["[]"]
