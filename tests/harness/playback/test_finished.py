"""A finished run renders the bits of its trained methods, or says why not."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baselines.catalog import CATALOG
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, ScoreSettings, TrainSettings
from harness.playback.run_loader import FinishedRun, from_plain
from harness.records.cells import cell_path, checkpoint_name, read_cell, records_folder
from harness.records.json_record import write_record
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, cameras_of, mean_scores, render_split, view_scores
from scenes.files.errors import DamagedRecord, InputError
from scenes.view_sets.view_set import ViewSet, read_view_set
from scenes.view_sets.viewpoints import RADIUS
from tests.harness.ball import DISTANCE, write_ball
from tests.harness.tiny import CPU, TRAIN
from tests.harness.trained_runs import SIZE, train_run
from tests.harness.voxels import SETTINGS, drjit_or_skip
from tests.replacing import replace

METHODS = ["nerf", "qnerf", "qnerf_running_mean"]
"""A pointwise density, one that depends on the chunk, and one with buffers in addition to its weights."""
OTHER_SETTINGS: dict[str, dict[str, Any]] = {
    "fine pass, bfloat16": {"fine_bins": 8, "precision": "bfloat16"},
    "no grid": {"grid": GridSettings(cells=0)},
    "before the grid": {"grid": replace(TRAIN.grid, first_step=100)},
    "without accelerations": {"accelerations": TRAIN.accelerations.without(("grid", "early_stop"))},
}
RUNS = [
    pytest.param(METHODS, {"steps": 24}, id="as usual"),
    pytest.param(
        ["nerf", "qnerf"],
        {"train": replace(TRAIN, fine_bins=8), "no_need": ["view_direction"]},
        id="fine pass, no view direction",
    ),
    *(
        pytest.param(METHODS[1:], {"train": replace(TRAIN, **changes)}, id=name, marks=pytest.mark.slow)
        for name, changes in OTHER_SETTINGS.items()
    ),
    *(
        pytest.param([name], {"train": SETTINGS}, id=name, marks=[pytest.mark.slow, pytest.mark.thorough])
        for name in CATALOG
        if name not in METHODS
    ),
]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    """Not to be changed."""
    return FinishedRun.of(train_run(tmp_path_factory.mktemp("three"), METHODS))


@pytest.fixture
def copy(finished: FinishedRun, tmp_path: Path) -> FinishedRun:
    return FinishedRun.of(Path(shutil.copytree(finished.out, tmp_path / "run")))


def views_of(learner: Learner, views: ViewSet, chunk: int) -> list[View]:
    return list(render_split(learner, cameras_of(views, views.test, CPU), chunk))


@pytest.mark.slow
@pytest.mark.parametrize(("methods", "options"), RUNS)
def test_what_is_restored_renders_and_scores_as_it_did(
    methods: list[str], options: dict[str, Any], tmp_path: Path
) -> None:
    """Bit for bit as the learners themselves when they had been trained."""
    if {"voxels_drjit", "ellipsoids"} & set(methods):
        drjit_or_skip()
    learners: list[Learner] = []
    run = FinishedRun.of(train_run(tmp_path, methods, on_trained=learners.append, **{"steps": 14, **options}))
    views = read_view_set(tmp_path / "ball")
    assert sorted(learner.method for learner in learners) == sorted(methods)
    for learner in learners:
        cell = run.trained(run.run.scenes[0], learner.method, 0, CPU)
        before, after = views_of(learner, views, 100), views_of(cell.learner, views, cell.chunk)
        assert len(before) == len(after) == 3
        for ours, theirs in zip(after, before, strict=True):
            for name in ("colour", "opacity", "depth"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        rows = [view_scores(view, views.test, index) for index, view in enumerate(after)]
        assert mean_scores(rows)["psnr"] == cell.cell.scores["psnr"]
        assert rows == cell.cell.views
        assert np.ptp(after[0].colour) > 0.01, "it shows something"


def test_it_knows_where_its_views_are_and_how_far_its_cameras_stand(
    copy: FinishedRun, tmp_path: Path, finished: FinishedRun
) -> None:
    scene = finished.run.scenes[0]
    ball = finished.out.parent / "ball"
    assert finished.view_set(scene) == ball
    assert finished.view_radius(scene) == pytest.approx(DISTANCE)
    ours = replace(scene, rendered={"digest": "x"})
    assert copy.view_radius(ours) == RADIUS
    own = FinishedRun(copy.out, replace(copy.run, settings={**copy.run.settings, "view_set": None}))
    with pytest.raises(InputError, match="--view-sets"):
        own.view_set(scene, tmp_path / "cache")
    shutil.copytree(ball, tmp_path / "view_sets" / "ball")
    assert own.view_set(scene, tmp_path / "cache") == tmp_path / "view_sets" / "ball"
    shutil.copytree(ball, tmp_path / "cache" / "ball")
    assert own.view_set(scene, tmp_path / "cache") == tmp_path / "cache" / "ball"


# names


def test_scenes_and_methods_are_all_or_those_asked_for(finished: FinishedRun) -> None:
    assert [scene.name for scene in finished.scenes(None)] == ["ball"]
    assert finished.methods(["qnerf", "nerf"]) == ["qnerf", "nerf"]
    assert finished.methods(None) == METHODS
    for ask, words in (
        (lambda: finished.scenes(["lego"]), "--scenes: unknown 'lego'; known: ball"),
        (lambda: finished.methods(["merf"]), "--methods: unknown 'merf'"),
        (lambda: finished.methods(["nerf", "nerf"]), "named twice"),
        (lambda: FinishedRun.of(finished.out / "records"), "holds no run"),
        (lambda: FinishedRun.of(finished.out / "nowhere"), "holds no run"),
        (lambda: finished.trained(finished.run.scenes[0], "nerf", 7, CPU), "nerf, seed 7 was not trained"),
    ):
        with pytest.raises(InputError, match=words):
            ask()
    assert finished.is_trained("ball", "nerf", 0)
    assert not finished.is_trained("ball", "nerf", 1)


# records


def edited(change: Callable[[dict[str, Any]], None]) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        data = json.loads(path.read_text(encoding="utf-8"))
        data.pop("digest", None)
        change(data)
        write_record(path, data)

    return edit


SPOILT: dict[str, tuple[Callable[[Path], None], str]] = {
    "not json": (lambda path: path.write_text("{"), "delete it and run again"),
    "diverged": (edited(lambda cell: cell.update(status="diverged", reason="not finite at step 7: loss")), "step 7"),
    "no train settings": (edited(lambda cell: cell["settings"].pop("train")), "not those of this version"),
    "no score settings": (edited(lambda cell: cell["settings"].pop("score")), "not those of this version"),
    "no focal length": (edited(lambda cell: cell["settings"]["view_set"].pop("focal")), "recorded before the focal"),
    "a setting less": (edited(lambda cell: cell["settings"]["train"].pop("bins")), "bins"),
    "a setting more": (edited(lambda cell: cell["settings"]["train"].update(colour=1)), "colour"),
    "no settings of its own": (edited(lambda cell: cell["settings"]["train"]["own"].pop("nerf")), "not those of this"),
    "own settings less": (edited(lambda cell: cell["settings"]["train"]["own"]["nerf"].pop("start")), "start"),
    "words for numbers": (edited(lambda cell: cell["settings"]["train"].update(bins="16")), r"\.bins"),
    "no precision": (edited(lambda cell: cell["settings"]["train"].update(precision="float7")), "float7"),
    "no switch": (edited(lambda cell: cell["settings"]["train"]["accelerations"].update(grid="off")), r"\.grid"),
    "wider": (edited(lambda cell: cell["settings"]["train"]["network"].update(width=17)), "not a checkpoint of nerf"),
    "a lens turned round": (edited(lambda cell: cell["settings"]["view_set"].update(focal=-1.5)), "focal length -1.5"),
    "no grid": (edited(lambda cell: cell["settings"]["train"]["grid"].update(cells=0)), "occupancy grid"),
    "another grid": (edited(lambda cell: cell["settings"]["train"]["grid"].update(cells=9)), "occupancy grid"),
}


@pytest.mark.parametrize("wrong", SPOILT)
def test_a_damaged_or_foreign_record_is_refused(wrong: str, copy: FinishedRun) -> None:
    spoil, words = SPOILT[wrong]
    spoil(cell_path(copy.out, "ball", "nerf", 0))
    with pytest.raises((InputError, DamagedRecord), match=words) as caught:
        copy.trained(copy.run.scenes[0], "nerf", 0, CPU)
    assert "ball.nerf.0" in str(caught.value) or "ball, nerf, seed 0" in str(caught.value)


@pytest.mark.parametrize("emptied", ["scenes", "methods"])
def test_a_run_of_nothing_is_refused(emptied: str, copy: FinishedRun) -> None:
    edited(lambda run: run.update({emptied: type(run[emptied])()}))(records_folder(copy.out) / "run.json")
    with pytest.raises(DamagedRecord, match=r"run\.json: names no scene or no method"):
        FinishedRun.of(copy.out)


@pytest.mark.parametrize("place", [0.02, 0.5, 0.99])
def test_weights_that_changed_since_they_were_written_are_refused(place: float, copy: FinishedRun) -> None:
    weights = copy.out / checkpoint_name("ball", "nerf", 0)
    data = bytearray(weights.read_bytes())
    data[int(place * len(data))] ^= 0x40
    weights.write_bytes(data)
    with pytest.raises(InputError, match="changed since it was written; --resume"):
        copy.trained(copy.run.scenes[0], "nerf", 0, CPU)


@pytest.mark.parametrize(
    ("settings", "scene", "words"),
    [
        *(
            ({"views": views}, {}, r"settings\.views")
            for views in ("--help", {"need": [["empty_space"]]}, {"no_need": 7})
        ),
        ({}, {"views": {"train": 5}}, "ball: views lacks the number of test"),
        ({}, {"bounds": [[-1.0, -1.0, 9.0], [1.0, 1.0, 1.0]]}, "ball: bounds"),
    ],
)
def test_settings_and_scenes_whose_views_cannot_be_read_are_refused_with_the_file(
    settings: dict[str, Any], scene: dict[str, Any], words: str, finished: FinishedRun
) -> None:
    spoilt = replace(finished, run=replace(finished.run, settings={**finished.run.settings, **settings}))
    with pytest.raises(DamagedRecord, match=rf"run\.json: {words}"):
        spoilt.views(replace(finished.run.scenes[0], **scene))


def test_a_method_that_is_no_more_is_refused(copy: FinishedRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.playback.run_loader.CATALOG", {"nerf": CATALOG["nerf"]})
    with pytest.raises(
        InputError, match="'qnerf' is not in this version's catalogue, and no installed package offers it: nerf"
    ):
        copy.trained(copy.run.scenes[0], "qnerf", 0, CPU)


# settings


@pytest.mark.parametrize(
    "settings",
    [
        TrainSettings(),
        *SETTINGS.own.values(),
        *(method.settings for method in CATALOG.values() if method.settings),
        replace(TRAIN, own={}, precision="bfloat16", accelerations=TRAIN.accelerations.without(("grid", "hull"))),
        Budget(steps=None, seconds=1.5),
        Budget(steps=7, seconds=None, core_seconds=4.0),
        ScoreSettings(),
    ],
)
def test_settings_go_through_json_and_come_back(settings: Any, tmp_path: Path) -> None:
    data = json.loads(json.dumps(settings.settings() if isinstance(settings, Budget) else asdict(settings)))
    assert from_plain(type(settings), data, tmp_path) == settings


def test_each_of_several_view_sets_is_a_scene_that_trains_as_it_would_alone(tmp_path: Path) -> None:
    other = write_ball(tmp_path / "other", size=SIZE, train=4, test=2)
    both = FinishedRun.of(train_run(tmp_path, ["nerf"], steps=3, others=[other]))
    assert [both.view_set(scene) for scene in both.scenes(["ball", "other"])] == [tmp_path / "ball", other]
    alone = train_run(tmp_path / "alone", ["nerf"], steps=3)
    assert losses(both.out, "ball") == losses(alone, "ball")
    assert losses(both.out, "ball") != losses(both.out, "other")


def losses(out: Path, scene: str) -> list[float]:
    return read_cell(cell_path(out, scene, "nerf", 0)).trace["loss"]
