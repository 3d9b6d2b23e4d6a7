"""Everything that a picture depends on changes its key, and nothing else does; the cache returns the same bits."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from baselines.contract import EVERY_ACCELERATION, Accelerations, Box
from harness.machine.provenance import PROGRAM
from harness.playback import cached, keys
from harness.playback.cached import CachedMethod
from harness.playback.keys import camera_key, method_digest, plain_calls, switches
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.checkpoints import load_checkpoint, save_checkpoint
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, render_view
from harness.training.trainer import Trainer
from tests.harness.ball import pose
from tests.harness.patching import preceded
from tests.harness.shell import ROOT
from tests.harness.tiny import CPU, TRAIN, rays_and_colours, train, trainer
from tests.harness.voxels import voxels

CALLS = plain_calls(512)
CAMERA = Camera(pose(0.3, 0.4), 12, 10, 16.0, 2.0, 6.0)


def trained(method: str = "nerf") -> Trainer:
    return train(trainer(method), 2)


@pytest.fixture(scope="module")
def nerf() -> Trainer:
    """Not to be changed."""
    return trained()


def key(learner: Learner, view: Camera = CAMERA, calls: str = CALLS) -> str:
    return camera_key(method_digest(learner), view, calls)


def test_the_same_view_has_the_same_key(nerf: Trainer) -> None:
    transposed = CAMERA.at(CAMERA.camera_to_world.T.copy().T)
    assert key(nerf) == key(trained()) == key(nerf, transposed)
    assert re.fullmatch("[0-9a-f]{64}", key(nerf)), "a file's name"


def ulp_away(entry: int, towards: float) -> dict[str, Any]:
    moved = pose(0.3, 0.4)
    moved.reshape(-1)[entry] = np.nextafter(moved.reshape(-1)[entry], towards)
    return {"camera_to_world": moved}


@pytest.mark.parametrize(
    "changes",
    [
        *(ulp_away(entry, towards) for entry in range(16) for towards in (-np.inf, np.inf)),
        {"focal": np.nextafter(16.0, 17.0)},
        {"near": np.nextafter(2.0, 3.0)},
        {"far": np.nextafter(6.0, 7.0)},
        {"width": 10, "height": 12},
        {"width": 13},
        {"height": 11},
    ],
)
def test_another_pose_or_lens_is_another_view(changes: dict[str, Any], nerf: Trainer) -> None:
    assert key(nerf, replace(CAMERA, **changes)) != key(nerf)


def trained_further(learner: Trainer) -> None:
    learner.train_on(*rays_and_colours(seed=9))


def ulp_less(tensor: torch.Tensor, *index: int) -> torch.Tensor:
    """Write through `.data`, which leaves no trace in torch's own count of versions."""
    tensor.data[index] = torch.nextafter(tensor.data[index], torch.tensor(-9.0))
    return tensor


def grid_changed(learner: Trainer) -> None:
    learner.grid.occupied[7] = False


def attribute(name: str, value: Callable[[Trainer], object]) -> Callable[[Trainer], object]:
    return lambda learner: setattr(learner, name, value(learner))


def setting(**changes: Any) -> Callable[[Trainer], object]:
    return attribute("settings", lambda learner: replace(learner.settings, **changes))


CHANGES: dict[str, Callable[[Trainer], object]] = {
    "one more training step": trained_further,
    "a weight": lambda learner: ulp_less(next(learner.fields.parameters()), 0, 0),
    "one cell of the occupancy mask": grid_changed,
    "the mask gone": attribute("grid", lambda _: None),
    "method": attribute("method", lambda _: "qnerf"),
    "quadrature": attribute("quadrature", lambda _: "listing4"),
    "direction": attribute("view_dependent", lambda _: False),
    "background": lambda learner: ulp_less(learner.background, 0),
    "box": attribute("box", lambda learner: Box(learner.box.lower, ulp_less(learner.box.upper.clone(), 0))),
    "device": attribute("device", lambda _: torch.device("meta")),
    # another number of bins holds before the grid is in use
    "more steps where no weight moves": attribute("step", lambda _: TRAIN.grid.first_step + 1),
    "bins": setting(bins=17, first_bins=17),
    "fine bins": setting(fine_bins=8),
    "network": setting(network=replace(TRAIN.network, colour_layers=1)),
    "bfloat16": setting(precision="bfloat16"),
    "float16": setting(precision="float16"),
    **{
        f"without {switch.name}": setting(accelerations=replace(EVERY_ACCELERATION, **{switch.name: False}))
        for switch in fields(Accelerations)
    },
}


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_a_picture_depends_on_is_in_the_key(change: str) -> None:
    learner = trained()
    before = key(learner)
    assert key(learner) == before
    CHANGES[change](learner)
    assert key(learner) != before


def test_each_method_seed_and_division_into_chunks_has_its_own_keys(nerf: Trainer) -> None:
    learners = [nerf, trained("qnerf"), trained("nerf_matched"), trainer(seed=1), trainer(seed=2)]
    keys_of_all = [
        key(learner, calls=calls) for learner in learners for calls in (CALLS, plain_calls(513), "region after region")
    ]
    assert len(set(keys_of_all)) == len(keys_of_all)


def test_other_sources_another_torch_or_processor_is_another_picture(
    nerf: Trainer, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = key(nerf)
    other = {"versions": {**keys.versions(), PROGRAM: "another"}, "processor": "another"}
    for name, value in other.items():
        with monkeypatch.context() as patch:
            patch.setattr(keys, name, lambda value=value: value)
            assert key(nerf) != before
    assert "torch" in keys.machine(nerf)["versions"]
    torch.set_num_threads(2)  # a fixture restores it
    assert key(nerf) != before


ELSEWHERE = """
import sys, torch
from pathlib import Path
from harness.training.checkpoints import load_checkpoint
from tests.harness.tiny import trainer
from tests.harness.playback.test_view_keys import key
torch.set_num_threads(1)
learner = trainer()
load_checkpoint(learner, Path(sys.argv[1]), 2)
print(key(learner))
"""


def test_another_process_has_the_same_key(tmp_path: Path) -> None:
    learner = trained()
    save_checkpoint(learner, tmp_path / "a.safetensors")
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, str(tmp_path / "a.safetensors")],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    again = trainer()
    load_checkpoint(again, tmp_path / "a.safetensors", 2)
    assert done.stdout.split() == [key(learner)] == [key(again)]


@contextmanager
def matmul_precision(precision: str) -> Iterator[None]:
    """Puts back those of the libraries: the old way of setting leaves "ieee" where "none" was, which means the same."""
    before = torch.get_float32_matmul_precision()
    libraries = [torch.backends.mkldnn.matmul, torch.backends.cuda.matmul, torch.backends.cudnn.conv]  # type: ignore
    each = [library.fp32_precision for library in libraries]
    torch.set_float32_matmul_precision(precision)
    yield
    torch.set_float32_matmul_precision(before)
    for library, value in zip(libraries, each, strict=True):
        library.fp32_precision = value


@contextmanager
def switched(holder: Any, name: str, value: object) -> Iterator[None]:
    before = getattr(holder, name)
    setattr(holder, name, value)
    yield
    setattr(holder, name, before)


ON_CPU: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "autocast": lambda: torch.autocast("cpu", torch.bfloat16),
    "autocast to another type": lambda: torch.autocast("cpu", torch.float16),
    "products of medium precision": lambda: matmul_precision("medium"),
    "oneDNN's products in bfloat16": lambda: switched(torch.backends.mkldnn.matmul, "fp32_precision", "bf16"),
    "without oneDNN": lambda: switched(torch.backends.mkldnn, "enabled", False),
}
CUDA_PRODUCTS: Any = torch.backends.cuda.matmul
ON_CUDA: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "products in TF32": lambda: switched(CUDA_PRODUCTS, "fp32_precision", "tf32"),
    "products of high precision": lambda: matmul_precision("high"),
    "cuDNN": lambda: switched(torch.backends.cudnn, "allow_tf32", not torch.backends.cudnn.allow_tf32),
    **{
        name: lambda name=name: switched(CUDA_PRODUCTS, name, not getattr(CUDA_PRODUCTS, name))  # type: ignore[misc]
        for name in ("allow_fp16_reduced_precision_reduction", "allow_bf16_reduced_precision_reduction")
    },
}


@pytest.mark.parametrize(("on_gpu", "name"), [(False, name) for name in ON_CPU] + [(True, name) for name in ON_CUDA])
def test_every_switch_of_arithmetic_is_in_the_key_whichever_others_were_set(on_gpu: bool, name: str) -> None:
    before = switches(on_gpu)
    with (ON_CUDA if on_gpu else ON_CPU)[name]():
        assert switches(on_gpu) != before
    assert switches(on_gpu) == before


def test_under_another_switch_a_view_is_not_found(nerf: Trainer) -> None:
    method = CachedMethod(nerf, ViewStore(), 512)
    method.keep(CAMERA, rendered(method))
    for other in ON_CPU.values():
        with other():
            assert method.lookup(CAMERA) is None
    assert method.lookup(CAMERA) is not None


# a method behind the cache


def rendered(method: CachedMethod) -> View:
    return render_view(method.learner, CAMERA.cameras(CPU), 0, method.chunk)


def test_the_view_that_is_found_is_bit_for_bit_the_rendered_one_until_the_method_is_trained(tmp_path: Path) -> None:
    method = CachedMethod(trained(), ViewStore(0, tmp_path), 50)
    method.keep(CAMERA, rendered(method))
    hit = CachedMethod(trained(), ViewStore(0, tmp_path), 50).lookup(CAMERA)
    for name in ("colour", "opacity", "depth"):
        assert getattr(hit[0], name).tobytes() == getattr(rendered(method), name).tobytes()
    assert np.ptp(hit[0].colour) > 0.0
    assert CachedMethod(trained(), ViewStore(0, tmp_path), 49).lookup(CAMERA) is None
    trained_further(method.learner)  # type: ignore[arg-type]
    assert method.lookup(CAMERA) is None


def test_weights_are_hashed_once(nerf: Trainer, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []
    preceded(monkeypatch, cached, "method_digest", calls.append)
    method = CachedMethod(nerf, ViewStore(), 50)
    for azimuth in range(5):
        method.lookup(CAMERA.at(pose(azimuth, 0.4)))
    assert len(calls) == 1


VOXEL_FACTS: dict[str, Callable[[Any], None]] = {
    "bins": lambda learner: setattr(learner, "own", replace(learner.own, bins=25)),
    "box": lambda learner: setattr(learner, "box", Box(learner.box.lower, learner.box.upper + 1e-6)),
    "a training step": trained_further,
}


@pytest.mark.parametrize("fact", VOXEL_FACTS)
def test_whatever_a_picture_of_voxels_depends_on_is_in_the_key(fact: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their weights are Dr.Jit's and not torch's."""
    learner = train(voxels(), 3)
    before = key(learner)
    with monkeypatch.context() as patch:
        patch.setattr(keys, "_drjit", lambda: ["0.0", [1, 2, 3]])
        assert key(learner) != before
    assert key(learner) == before
    VOXEL_FACTS[fact](learner)
    assert key(learner) != before
