"""The cost of the paper's table: its work is counted by hand, and the published page is up to date."""

from dataclasses import replace
from pathlib import Path

import pytest
from msgspec import structs

from harness.plan.profiles import PROFILES
from harness.plan.schedule import Budget
from harness.records.study import Studies, read_studies
from harness.studies.speed import full_setting
from harness.studies.speed.full_setting import paper_table, value_of, work_of
from scenes.files.errors import InputError

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def speed() -> Studies:
    return read_studies(DOCS / "speed.json")


def test_the_work_of_a_cell_equals_a_count_by_hand() -> None:
    work = work_of(paper_table())
    # encoded position 63, direction 27; 8 × 256 with the position again after the fourth layer; heads 1 and 128-128-3
    three = 256 * 256 * 7 + 256 + 256 * 128 + 128 * 128 + 128 * 3
    two = 63 * 256 * 2
    per_point = 2 * (3 * three + 2 * two)
    per_ray = 2 * 2 * 27 * 128
    step = 1024 * (64 + 192) * per_point + 1024 * per_ray
    assert work.training == pytest.approx(200_000 * step, rel=1e-12)
    assert work.scoring == pytest.approx((11 * 8 + 200 + 4) * 800**2 * step / 1024 / 3, rel=1e-12)
    assert (work.cells, work.groups) == (320, 40)
    # 12 dB for ten times the samples, and 95 to 400 of them for 45 dB
    for megasamples, needed in zip(work.megasamples, (95, 400), strict=True):
        train, test = (min(256, needed * 10 ** ((db - 45) / 12)) for db in (36, 40))
        assert megasamples == pytest.approx(8 * 200 * (train + test) * 0.64)
    assert work.decoded == 300 * 800 * 800 * 4 * 4


def test_the_count_agrees_with_a_measurement(speed: Studies) -> None:
    """The time of a view of 100 × 100 with 64 samples per ray, from operations at the rate of training and measured."""
    plan = paper_table(replace(PROFILES["full"], train=replace(PROFILES["full"].train, fine_bins=0)))
    plan = replace(
        plan,
        views=replace(plan.views, resolution=100, test=1),
        score=replace(plan.score, checkpoints=1, train_views=0),
    )
    seconds = work_of(plan).scoring / full_setting.measured_rate(speed)
    assert seconds == pytest.approx(value_of(speed, "rendering.paper.seconds"), rel=0.2)


def test_the_smallest_assumed_shares_are_about_those_of_a_measured_h100() -> None:
    gpu, sheet = read_studies(DOCS / "gpu" / "speed.json"), full_setting.GPUS["NVIDIA H100 or H200, SXM"]
    rate = value_of(gpu, "matrix.paper.rate")
    per_sample = rate / value_of(gpu, "training.dense.accelerated.rate")  # both in bfloat16
    reached = {"bfloat16": rate, "float32": per_sample * value_of(gpu, "training.dense.float32.rate")}
    for precision, (smallest, _) in full_setting.ASSUMED_SHARES.items():
        assert reached[precision] / sheet[precision] == pytest.approx(smallest, rel=0.3)


def test_work_is_not_divided_below_a_group() -> None:
    work = work_of(paper_table())
    assert [full_setting.wall_hours(work, 1.0, gpus) for gpus in (1, 8, 39, 40, 64)] == [320, 40, 16, 8, 8]


def test_the_fastest_variant_that_works_renders(speed: Studies) -> None:
    assert full_setting.render_seconds(speed) == (value_of(speed, "render.lego.llvm_ad_rgb.seconds"),
                                     value_of(speed, "render.hotdog.llvm_ad_rgb.seconds"))  # fmt: skip
    studies = [
        structs.replace(study, findings=[check for check in study.checks if "llvm" not in check.id])
        for study in speed.studies
    ]
    scalar = structs.replace(speed, studies=studies)
    assert full_setting.render_seconds(scalar)[0] == value_of(speed, "render.lego.scalar_rgb.seconds")
    with pytest.raises(InputError, match="no seconds of rendering"):
        full_setting.render_seconds(structs.replace(speed, studies=[]))
    with pytest.raises(InputError, match=r"no matrix\.paper\.rate"):
        full_setting.page(structs.replace(speed, studies=[]))
    with pytest.raises(InputError, match="for steps"):
        work_of(replace(paper_table(), budget=Budget(None, 60.0)))


def test_the_page_of_the_repository_is_up_to_date(speed: Studies) -> None:
    assert full_setting.page(speed) == (DOCS / "scaling.md").read_text(encoding="utf-8"), (
        "python -m harness study scaling > docs/scaling.md"
    )
