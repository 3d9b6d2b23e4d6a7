"""Records: read as written, atomic, and without NaN."""

import json
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.records import json_record
from harness.records.cells import (
    HELD,
    USUAL,
    CellRecord,
    Comparison,
    Estimate,
    LeftOut,
    Roles,
    RunRecord,
    SceneRecord,
    Scores,
    cell_path,
    digests_of,
    read_cell,
    read_cells,
    read_cells_of,
    read_comparisons,
    read_run,
    write_cell,
    write_comparisons,
    write_run,
)
from harness.records.json_record import digest_of, load_json, plain, write_record
from harness.records.metric_table import METRICS, POSSIBLE
from harness.records.verdict import OPEN, Verdict
from harness.verdicts.claim_files import known_claims
from scenes.files.errors import DamagedRecord, as_text
from tests.harness.cells import cell, checkpoint, diverged
from tests.replacing import replace


def one_cell() -> CellRecord:
    density = {"edges": [0.0, 0.5, 1.0], "before": [0.25, 0.75], "after": [1.0, 0.0], "points": [3, 4]}
    curve = [checkpoint(10, 1.5, None), replace(checkpoint(20, 3.0, 21.5), density=density, alpha=0.618)]
    return cell("lego", "qnerf", 2, curve)


def test_scores_have_a_field_for_every_metric_in_the_order_of_the_table() -> None:
    assert Scores.__struct_fields__ == tuple(METRICS)


HERE = Estimate((0.0, 0.2), (-0.1, 0.3), 48, Verdict("open", "open"), 0.1, None)


def one_run() -> RunRecord:
    scene = SceneRecord(
        "lego", "Bricks", "lego-32px-abc", 32, 32, {"train": 2, "val": 0, "test": 1}, 2.0, 6.0,
        [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], 40.0, None, {"variant": "scalar_rgb"},
        [LeftOut("background", "alpha is known", 0.5, 0.1, (0.0, 0.2)), LeftOut("medium", "none", None, None, None)],
    )  # fmt: skip
    return RunRecord(
        "smoke", "python -m harness run", [scene], {"nerf": "vanilla"}, ["φ"], [0, 1], {"rays": 1},
        {"commit": "x"}, {"total": 3.0}, True, ["much"],
    )  # fmt: skip


def test_a_run_and_comparisons_come_back_as_they_were_written(tmp_path: Path) -> None:
    duel = ("lego", "qnerf", "nerf", "ssim")
    rows = [
        Comparison(*duel, "seconds", None, None, OPEN, None, 0, 3, None, 1, None, None),
        Comparison(*duel, "steps", 0.1, (0.0, 0.2), Verdict("above 0", "open"), 0.1, 3, 0, (-0.1, 0.3), 48, HERE, None),
    ]
    write_run(tmp_path, one_run())
    write_comparisons(tmp_path, rows)
    assert read_run(tmp_path) == one_run()
    assert read_comparisons(tmp_path) == rows
    assert read_comparisons(tmp_path / "elsewhere") == []


finite, text = st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=8)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3),
    max_leaves=6,
)


@given(
    reason=st.none() | text,
    # any number is a score of a metric that is not known
    scores=st.dictionaries(text.filter(lambda name: name not in POSSIBLE), st.none() | finite, max_size=3),
    provenance=st.dictionaries(text, json_values, max_size=3),
)
@settings(deadline=None, max_examples=60)
def test_any_cell_comes_back_as_it_was_written(reason: str | None, scores: Any, provenance: Any) -> None:
    record = replace(one_cell(), reason=reason, scores=scores, provenance=provenance)
    with tempfile.TemporaryDirectory() as folder:
        out, path = Path(folder), cell_path(Path(folder), "lego", "qnerf", 2)
        write_cell(out, record)
        written = path.read_bytes()
        assert list(read_cells(out)) == [record]
        write_cell(out, read_cell(path))
        assert path.read_bytes() == written, "an interrupted run writes the bytes of one that was not"


@pytest.mark.parametrize(("metric", "value"), [("psnr", -5.0), ("psnr", 1e308), ("ssim", 5.0), ("flip", -0.1)])
def test_scores_that_no_images_have_are_refused(metric: str, value: float, tmp_path: Path) -> None:
    cell = one_cell()
    at_the_end = replace(cell, scores={**cell.scores, metric: value})
    on_the_curve = replace(cell, curve=[replace(cell.curve[0], **{metric: value}), *cell.curve[1:]])
    for record in (at_the_end, on_the_curve):
        write_cell(tmp_path, record)
        with pytest.raises(DamagedRecord, match=f"{metric} .* is not a possible score"):
            list(read_cells(tmp_path))


def test_comparisons_of_other_cells_are_not_believed(tmp_path: Path) -> None:
    cell = one_cell()
    write_comparisons(tmp_path, [], digests_of([cell]))
    assert read_comparisons(tmp_path, [cell]) == []
    with pytest.raises(DamagedRecord, match=r"was made when the cell lego\.qnerf\.2\.json held something else"):
        read_comparisons(tmp_path, [replace(cell, scores={**cell.scores, "psnr": cell.scores["psnr"] + 30.0})])


def test_what_a_version_adds_to_a_record_changes_no_digest_of_an_older_one(tmp_path: Path) -> None:
    cell = replace(one_cell(), costs={}, curve=[replace(point, dead_units=None) for point in one_cell().curve])
    (digest,) = digests_of([cell]).values()
    data = json.loads(json.dumps(plain(cell)))
    data.pop("costs")
    data["curve"] = [dict(reversed([(key, value) for key, value in point.items() if key != "dead_units"]))
                     for point in data["curve"]]  # fmt: skip
    assert digest == HELD + digest_of(json_record.without_gaps(dict(reversed(data.items()))))
    assert digests_of([replace(cell, costs={"view_seconds": 1.0})]) != {"lego.qnerf.2.json": digest}
    # a former version digested keys in their order, and empty values
    write_comparisons(tmp_path, [], {"lego.qnerf.2.json": digest_of(plain(cell))})
    assert read_comparisons(tmp_path, [cell]) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_and_the_old_file_stays(bad: float, tmp_path: Path) -> None:
    write_cell(tmp_path, one_cell())
    with pytest.raises(ValueError, match="JSON"):
        write_cell(tmp_path, replace(one_cell(), scores={"psnr": bad}))
    assert list(read_cells(tmp_path)) == [one_cell()]
    assert [json_record.finite_or_none(value) for value in (bad, None, 2.5)] == [None, None, 2.5]


def test_hidden_files_of_others_and_cells_of_no_plan_are_passed_over(tmp_path: Path) -> None:
    both = [diverged(scene, "nerf", 0) for scene in ("lego", "ship")]
    for record in reversed(both):
        write_cell(tmp_path, record)
    cells = tmp_path / "records" / "cells"
    (cells / "._lego.nerf.0.json").write_bytes(b"\x00\x05\x16\x07")
    assert list(read_cells(tmp_path)) == both
    (cells / "notes.json").write_text("mine")
    assert list(read_cells_of(tmp_path, [("lego", "nerf", 0), ("lego", "qnerf", 0)])) == both[:1]


def test_a_command_that_is_not_utf_8_can_be_recorded(tmp_path: Path) -> None:
    command = as_text("python -m harness run --out r\udce9sum\udce9 ж")
    json_record.write_json(tmp_path / "run.json", {"command": command})
    assert load_json(tmp_path / "run.json") == {"command": r"python -m harness run --out r\udce9sum\udce9 ж"}


def damage(out: Path, change: Any) -> Path:
    write_cell(out, one_cell())
    path = cell_path(out, "lego", "qnerf", 2)
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["digest"]  # which would say that it was changed, not how
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def test_a_record_of_an_earlier_version_still_opens(tmp_path: Path) -> None:
    """A whole number is a number, what was added later may be missing, and pictures were of another kind."""

    def earlier(data: dict[str, Any]) -> None:
        for name in ("files", "costs", "train_core_seconds", "pictures"):
            del data[name]
        for name in ("flip", "core_seconds"):
            del data["curve"][0][name]
        data.update(train_seconds=3, images=[{"view": "test/r_0"}])

    path = damage(tmp_path, earlier)
    write_record(path, json.loads(path.read_text(encoding="utf-8")))
    assert read_cell(path) == replace(one_cell(), train_seconds=3.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data.update(schema=99), "schema 99, this version reads 1"),
        (lambda data: data.pop("schema"), "schema None"),
        (lambda data: data["curve"][0].update(colour="red"), "unknown field `colour` - at `$.curve[0]`"),
        (lambda data: data["curve"][0].pop("step"), "missing required field `step` - at `$.curve[0]`"),
        (lambda data: data["views"].append(3), "got `int` - at `$.views[1]`"),
        (lambda data: data.update(views=None), "got `null` - at `$.views`"),
        (lambda data: data.update(steps=20.0), "got `float` - at `$.steps`"),
        (lambda data: data.update(steps=10**18), "`int` <= 1000000000000000 - at `$.steps`"),
        (lambda data: data.update(train_seconds=-5.0), "`float` >= 0.0 - at `$.train_seconds`"),
        (lambda data: data.update(status="fine"), "'fine' - at `$.status`"),
        (lambda data: data["scores"].update(psnr=True), "got `bool` - at `$.scores[...]`"),
        (lambda data: data.update(steps="9" * 4000), "got `str` - at `$.steps`"),
        (lambda data: data.update({"c" * 4000: 1}), "…"),
    ],
)
def test_a_changed_record_is_refused_by_name(change: Any, said: str, tmp_path: Path) -> None:
    path = damage(tmp_path, change)
    with pytest.raises(DamagedRecord) as caught:
        read_cell(path)
    assert str(path) in str(caught.value)
    assert said in str(caught.value)
    assert "run again" in str(caught.value)
    assert len(str(caught.value)) < 1000


BROKEN = ['{"schema": NaN}', '{"schema": 1e999}', '{"schema": "\\ud800"}', '{"a":' * 9000 + "1" + "}" * 9000]


@pytest.mark.parametrize("content", ["", "{", "[]", "3", '{"schema": 1', "\0\0\0", *BROKEN])
def test_a_truncated_record_is_refused_by_name(content: str, tmp_path: Path) -> None:
    write_cell(tmp_path, one_cell())
    path = cell_path(tmp_path, "lego", "qnerf", 2)
    path.write_text(content)
    with pytest.raises(DamagedRecord, match=r"lego\.qnerf\.2\.json"):
        list(read_cells(tmp_path))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tables": {"weights": {"total": "many"}}}, r"got `str` - at `\$\.claims\[0\]\.tables"),
        ({"tables": {"ablation": [{"method": "nerf"}]}}, "missing required field"),
        ({"claims": {}}, r"got `object` - at `\$\.claims\[0\]\.claims`"),
    ],
)
def test_claims_that_are_none_are_refused(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    (paper,) = known_claims()
    write_run(tmp_path, replace(one_run(), claims=[replace(paper, **changes)]))
    with pytest.raises(DamagedRecord, match=said):
        read_run(tmp_path)


ALL = ["nerf", "nerf_matched", "mine", "other"]


@pytest.mark.parametrize(
    ("roles", "methods", "baseline", "pairs"),
    [
        (USUAL, ["nerf", "mine"], "nerf", [("mine", "nerf")]),
        (USUAL, ["mine", "other"], "mine", [("other", "mine")]),
        (USUAL, ["nerf", "nerf_matched", "mine"], "nerf",
         [("nerf_matched", "nerf"), ("mine", "nerf"), ("mine", "nerf_matched")]),
        (Roles("mine"), ["nerf", "mine"], "mine", [("nerf", "mine")]),
        (Roles("nerf", claimed=(("other", "mine"), ("mine", "nerf"), ("other", "lost"))), ["nerf", "mine", "other"],
         "nerf", [("mine", "nerf"), ("other", "nerf"), ("other", "mine")]),
    ],
)  # fmt: skip
def test_roles_decide_the_pairs(roles: Roles, methods: list[str], baseline: str, pairs: list[tuple[str, str]]) -> None:
    assert roles.among(methods).baseline == baseline
    assert roles.pairs(methods) == pairs
    assert roles.pairs([]) == []


def test_contenders_are_all_others_or_else_the_controls() -> None:
    assert USUAL.contenders(ALL) == ["mine", "other"]
    assert USUAL.contenders(ALL[:2]) == ["nerf_matched"]
    assert USUAL.contenders(ALL[:1]) == []
