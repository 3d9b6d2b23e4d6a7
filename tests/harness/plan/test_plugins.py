"""Methods of a user's own package: found, loaded when asked for, refused with a reason, recorded, and told apart."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG
from baselines.composition import LADDERS, SKIPS
from harness.command.plan_options import planned
from harness.plan import plugins
from harness.plan.plugins import method_named
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.playback.run_loader import FinishedRun
from harness.studies.conformance.method_checks import CHECKS, LEARNER_CHECKS, conformance
from harness.studies.conformance.subject import BOX, Subject
from harness.training.learner import Job
from harness.training.make_learner import learner_for
from scenes.files.errors import InputError
from tests.harness.ball import write_ball
from tests.harness.shell import ROOT, refused
from tests.replacing import replace

EXAMPLE = ROOT / "docs" / "examples" / "method_package"
EXAMPLES = ("nerf_base3", "blobs", "voxel_grid")
HEAD = (
    "from dataclasses import replace\nfrom baselines.catalog import CATALOG, Method\n"
    "from baselines.composition import LADDERS\nfrom baselines.methods.nerf import NERF\n"
)
METHOD = {"__init__.py": HEAD + "M = Method(NERF, 'x')"}
"""The file of a package that offers nerf under another name."""


def install(site: Path, package: str, points: dict[str, str], files: dict[str, str] | None = None) -> Path:
    """What an installer leaves: the package's files and the facts about it."""
    module = package.replace("-", "_")
    facts = site / f"{module}-1.2.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
    lines = [f"{name} = {value}" for name, value in points.items()]
    (facts / "entry_points.txt").write_text("\n".join([f"[{plugins.GROUP}]", *lines, ""]))
    for name, text in (files or {}).items():
        (site / module).mkdir(exist_ok=True)
        (site / module / name).write_text(text)
    return site


@pytest.fixture(autouse=True)
def without_a_trial(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of its own for each import takes seconds: one test has it."""
    if "ended" not in request.fixturenames:
        monkeypatch.setattr(plugins, "how_it_ends", lambda *_: "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "ended"),
    [
        ("import os\nos._exit(0)", "importing it ends the process with exit code 0"),
        ("raise KeyboardInterrupt", "importing it raises KeyboardInterrupt"),
        ("raise MemoryError", "cannot be loaded: MemoryError"),
        ("raise SystemExit(0)", "cannot be loaded: SystemExit: 0"),
    ],
)
def test_a_package_that_ends_its_process_is_named(site: Path, text: str, ended: str) -> None:
    install(site, "ender", {"mine": "ender:METHOD"}, {"__init__.py": text})
    with pytest.raises(InputError, match=ended) as caught:
        plugins.require_methods(["mine"])
    assert "package ender 1.2" in str(caught.value)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder of packages; whatever is loaded from it is forgotten afterwards."""
    folder = tmp_path / "site"
    folder.mkdir()
    tables: list[dict[str, Any]] = [CATALOG, LADDERS, AMPLIFIERS, SKIPS, plugins._loaded]
    before = [dict(table) for table in tables]
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    for table, kept in zip(tables, before, strict=True):
        for name in set(table) - set(kept):
            del table[name]
    # nothing else that was first imported meanwhile: torch's compiler cannot be imported twice
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(str(folder)):
            del sys.modules[name]
    plugins.sources_digest.cache_clear()


@pytest.fixture
def example(site: Path) -> Path:
    """The documented package, as it stands there."""
    points = {name: f"my_radiance_methods:{name.upper()}" for name in EXAMPLES}
    install(site, "my-radiance-methods", points)
    (site / "my_radiance_methods").symlink_to(EXAMPLE / "my_radiance_methods")
    return site


def test_the_documented_entry_points_are_those_that_are_tested() -> None:
    text = (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8")
    assert f'[project.entry-points."{plugins.GROUP}"]' in text
    assert all(f'{name} = "my_radiance_methods:{name.upper()}"' in text for name in EXAMPLES)


def test_a_package_is_listed_without_being_imported(example: Path) -> None:
    assert plugins.method_names()[-3:] == list(EXAMPLES)
    assert "my_radiance_methods" not in sys.modules
    planned("smoke")
    assert "my_radiance_methods" not in sys.modules


def test_a_method_that_is_named_is_loaded_with_its_parts_and_its_origin(example: Path) -> None:
    assert planned("smoke", methods=["nerf", *EXAMPLES]).methods == ("nerf", *EXAMPLES)
    assert LADDERS["base3"].base == 3.0
    recorded: Any = plugins.origins(["nerf", "blobs"])["plugins"]
    assert set(recorded) == {"blobs"}
    assert (recorded["blobs"]["package"], recorded["blobs"]["version"]) == ("my-radiance-methods", "1.2")
    assert recorded["blobs"]["entry_point"] == "my_radiance_methods:BLOBS"
    assert plugins.title_of("blobs").endswith("(package my-radiance-methods 1.2)")


@pytest.mark.slow
@pytest.mark.parametrize("method", EXAMPLES)
def test_the_documented_package_conforms(example: Path, method: str) -> None:
    outcomes = list(conformance(Subject(method)))
    applicable = CHECKS if method_named(method).is_field else LEARNER_CHECKS
    assert [one.check for one in outcomes] == list(CHECKS)
    expected = {True: "held", False: "not applicable"}
    assert [one for one in outcomes if one.verdict != expected[one.check in applicable]] == []


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("raise SystemExit('bye')", "SystemExit: bye"),
        ("1 +", "SyntaxError"),
        ("raise ValueError('two\\nlines')", "ValueError: two lines"),
        (HEAD + "CATALOG['nerf'] = None", "AttributeError"),
        (HEAD + "CATALOG['nerf'] = M = Method(NERF, 'mine')", "importing it replaces 'nerf' of this program"),
        (HEAD + "LADDERS['phi'] = 3\nM = Method(NERF, 'x')", "importing it replaces 'phi' of this program"),
        ("M = 'a string'", "gives a str, not a baselines.catalog.Method"),
        (HEAD + "M = Method(NERF, ' ')", "no title"),
        (HEAD + "M = Method(None, 'x')", "parts as its settings, make_field"),
        (HEAD + "M = Method(3, 'x')", "its settings are of type int, not a frozen dataclass"),
        (
            HEAD + "M = Method(NERF, 'x')\nobject.__setattr__(M, 'trainer', 3)",
            "its trainer is of type int, not a callable",
        ),
        (HEAD + "M = Method(replace(NERF, start=float('inf')), 'x')", "its settings are not JSON"),
        (HEAD + "M = Method(NERF, 'x', deviations=('It has {voxels}.',))", "KeyError: 'voxels'"),
        (HEAD + "M = Method(NERF, 'x', 'a:b')", "parts as its settings, make_field, or a trainer"),
        (HEAD + "M = Method(replace(NERF, encoding='base9'), 'x')", "encoding 'base9' is unknown; known: base2"),
        (HEAD + "M = Method(replace(NERF, loss='cubed'), 'x')", "loss 'cubed' is unknown; known: squared"),
        (HEAD + "M = Method(replace(NERF, decay='sudden'), 'x')", "decay 'sudden' is unknown; known: exponential"),
        (HEAD + "M = Method(replace(NERF, learning_rate=0.0), 'x')", "its learning_rate 0.0 is not a positive number"),
        (HEAD + "M = Method(replace(NERF, warm_up_steps=-1), 'x')", "its warm_up_steps -1 is below 0"),
        (HEAD + "M = Method(replace(NERF, depth=0), 'x')", "its depth 0 is below 1; leave it out for the run's"),
        (HEAD + "M = Method(replace(NERF, quadrature='guess'), 'x')", "quadrature 'guess' is unknown"),
        (HEAD + "M = Method(NERF, 'x', skips={'half': len})", "skip 'half' is taken"),
    ],
)
def test_what_is_wrong_with_a_package_is_said_in_one_line(
    site: Path, capsys: pytest.CaptureFixture[str], code: str, said: str
) -> None:
    before = dict(LADDERS), dict(SKIPS), dict(CATALOG)
    install(site, "bad-luck", {"mine": "bad_luck:M"}, {"__init__.py": code})
    text = refused(capsys, "--profile", "smoke", "--methods", "nerf", "mine", "--dry-run")
    assert "package bad-luck 1.2 (entry point mine = bad_luck:M)" in text
    assert said in text
    assert (dict(LADDERS), dict(SKIPS), dict(CATALOG)) == before, "a refused package leaves nothing behind"


def test_a_trainer_that_is_not_there_is_named(site: Path) -> None:
    code = HEAD + "M = Method(None, 'x', 'nowhere_to_be_found:Trainer')"
    install(site, "bad-luck", {"mine": "bad_luck:M"}, {"__init__.py": code})
    with pytest.raises(InputError, match="mine: its trainer nowhere_to_be_found:Trainer cannot be imported"):
        learner_for(Job("mine", BOX, PROFILES["smoke"].train, Budget(1, None), 0, torch.device("cpu")))


def test_workers_take_the_settings_of_a_package_from_the_package(example: Path, tmp_path: Path) -> None:
    """A node of a cluster could not unpickle its classes before it has asked for the package."""
    plan = replace(planned("smoke", methods=["nerf", "blobs"]), scenes=("lego",))
    (task, *_) = plan.tasks({"lego": tmp_path}, Machine("cpu", 1, 1), tmp_path)
    assert set(task.train.own) == {"nerf"}
    assert plan.settings()["train"]["own"]["blobs"] == task.settings("blobs")["train"]["own"]["blobs"]
    assert task.settings("blobs")["train"]["own"]["blobs"]["count"] == 64


@pytest.mark.parametrize(
    ("name", "packages", "said"),
    [
        ("nerf", ["usurper"], "belongs to radiance-verdict, and package usurper 1.2"),
        ("mine", ["first_one", "second_one"], r"first_one 1\.2 .* and package second_one 1\.2|second_one .* first_one"),
        ("../../mine", ["climber"], "letters, digits"),
    ],
)
def test_a_name_that_is_taken_or_offered_twice_or_could_leave_the_folder_is_refused(
    site: Path, name: str, packages: list[str], said: str
) -> None:
    before = CATALOG.get(name)
    for package in packages:
        install(site, package, {name: f"{package}:M"}, METHOD)
    with pytest.raises(InputError, match=said):
        planned("smoke", methods=[name])
    assert CATALOG.get(name) is before
    assert not {*packages} & {*sys.modules}


def digest(name: str) -> str:
    plugins.sources_digest.cache_clear()
    (point,) = plugins.offered()[name]
    return plugins.sources_digest(point)


@pytest.mark.parametrize("editable", [False, True])
def test_the_digest_is_of_everything_that_a_package_brings(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch, editable: bool
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path / "project"))
    install(site, "changing", {"mine": "changing.inner:M"})
    facts, home = site / "changing-1.2.dist-info", tmp_path / "project" if editable else site
    counted = ["changing/__init__.py", "changing/inner.py", "changing/weights.bin", "changing/deep/facts.json"]
    beside = ["helper.py", "fast.abi3.so", "second/__init__.py", "second/table.json"]
    not_counted = ["changing/__pycache__/inner.pyc", "changing/.draft"]
    if not editable:
        not_counted.append("changing-1.2.dist-info/INSTALLER")
    for name in [*counted, *beside, *not_counted, "of_another.json"]:
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_bytes(b"")
    if editable:
        (facts / "direct_url.json").write_text('{"url": "file:///x", "dir_info": {"editable": true}}')
    else:
        (facts / "RECORD").write_text("".join(f"{one},,\n" for one in [*counted, *beside, *not_counted]))
    before = digest("mine")
    assert digest("mine") == before
    for name in [*not_counted, "of_another.json"]:
        (home / name).write_bytes(b"another")
        assert digest("mine") == before, name
    for name in [*counted, *beside]:
        (home / name).write_bytes(b"#")
        assert digest("mine") != before, name
        (home / name).write_bytes(b"")


@pytest.mark.parametrize(
    ("note", "text"), [("direct_url.json", "{"), ("RECORD", '"' + "x" * 200_000), ("RECORD", "a,b,c,d,e\n")]
)
def test_an_installation_whose_notes_are_damaged_is_refused_by_name(
    site: Path, capsys: pytest.CaptureFixture[str], note: str, text: str
) -> None:
    install(site, "torn", {"mine": "torn:M"}, METHOD)
    (site / "torn-1.2.dist-info" / note).write_text(text)
    said = refused(capsys, "--profile", "smoke", "--methods", "nerf", "mine", "--dry-run")
    assert "package torn 1.2 (entry point mine = torn:M): its files cannot be read" in said
    assert "mine" not in CATALOG


def test_views_of_a_changed_package_are_other_views(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from harness.playback.keys import method_digest
    from harness.studies.conformance.learner_checks import fresh

    install(site, "changing", {"mine": "changing:M"}, METHOD)
    one = method_digest(fresh(Subject("mine")))
    assert method_digest(fresh(Subject("mine"))) == one
    (site / "changing" / "__init__.py").write_text(HEAD + "M = Method(NERF, 'x')\n# another thought\n")
    for table in (CATALOG, plugins._loaded, sys.modules):
        table.pop("mine" if table is not sys.modules else "changing")  # type: ignore[attr-defined]
    plugins.sources_digest.cache_clear()
    assert method_digest(fresh(Subject("mine"))) != one


@pytest.mark.slow
@pytest.mark.thorough
def test_a_run_trains_it_in_worker_processes_records_it_and_gives_it_back(example: Path, tmp_path: Path) -> None:
    write_ball(tmp_path / "ball", size=16, train=5, test=2)
    options = ["--profile", "smoke", "--view-set", str(tmp_path / "ball"), "--resolution", "16", "--seeds", "1"]
    more = ["--budget-steps", "20", "--workers", "1", "--quiet", "--out", str(tmp_path / "run")]
    command = [sys.executable, "-m", "harness", "run", *options, *more, "--methods", "nerf", *EXAMPLES]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(example)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    run = json.loads((tmp_path / "run" / "records" / "run.json").read_text())
    assert run["provenance"]["plugins"]["blobs"]["version"] == "1.2"
    assert "my-radiance-methods 1.2" in run["methods"]["nerf_base3"]
    cell = json.loads((tmp_path / "run" / "records" / "cells" / "ball.blobs.0.json").read_text())
    assert cell["status"] == "done"
    assert cell["provenance"]["plugins"]["blobs"]["package"] == "my-radiance-methods"
    finished = FinishedRun.of(tmp_path / "run")
    trained = finished.trained(finished.scenes(None)[0], "blobs", 0, torch.device("cpu"))
    assert trained.learner.field.parameter_counts()["total"] == 64 * 8
