"""Checkpoints: they restore what was saved, their digest covers every bit, and other files are refused."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from harness.training.checkpoints import OCCUPIED, checkpoint_path, load_checkpoint, save_checkpoint, weights_digest
from harness.training.learner import Job, Learner
from scenes.files.errors import InputError
from tests.harness.tiny import TRAIN, rays_and_colours, train, trainer
from tests.harness.voxels import voxels

STEPS = 12
"""A number of steps past the first refresh of the grid."""


def trained(method: str, **changes: Any) -> Any:
    return train(trainer(method, replace(TRAIN, **changes)), STEPS)


CASES: dict[str, Callable[[], Any]] = {
    "nerf": lambda: trained("nerf"),
    "qnerf": lambda: trained("qnerf"),
    "running mean": lambda: trained("qnerf_running_mean"),
    "fine pass": lambda: trained("nerf", fine_bins=8),
    "no grid": lambda: trained("nerf", grid=replace(TRAIN.grid, cells=0)),
    "voxels": lambda: train(voxels(), STEPS),
}


def fresh(like: Any) -> Any:
    return type(like)(Job(like.method, like.box, like.settings, like.budget, "another seed", like.device))


@pytest.mark.parametrize("case", CASES)
def test_what_is_loaded_is_what_was_saved(case: str, tmp_path: Path) -> None:
    before = CASES[case]()
    path = checkpoint_path(tmp_path, "ball", before.method, 0)
    save_checkpoint(before, path)
    assert [file.name for file in path.parent.iterdir()] == [f"ball.{before.method}.0.safetensors"]
    after = fresh(before)
    assert weights_digest(after) != weights_digest(before)
    load_checkpoint(after, path, before.step)
    assert weights_digest(after) == weights_digest(before)
    assert after.step == STEPS
    rays, _ = rays_and_colours(seed=99)
    assert torch.equal(after.render(rays, 50).colour, before.render(rays, 50).colour)


# digest


def digest(**tensors: torch.Tensor) -> str:
    learner: Any = SimpleNamespace(grid=None, fields=SimpleNamespace(state_dict=lambda: tensors))
    return weights_digest(learner)


def test_the_digest_is_of_names_types_shapes_and_bits_not_of_their_order() -> None:
    a, b = torch.arange(6.0), torch.ones(2, dtype=torch.bool)
    told = digest(a=a, b=b)
    assert digest(b=b, a=a) == told
    assert digest(a=torch.stack([a, a], dim=1)[:, 0], b=b) == told, "however it lies in memory"
    others = [
        digest(a=a.reshape(2, 3), b=b),
        digest(a=a.double(), b=b),
        digest(a=a.view(torch.int32), b=b),
        digest(a=a, c=b),
        digest(a=b, b=a),
        digest(a=a),
        digest(a=-0.0 * a, b=b),
        digest(a=0.0 * a, b=b),
        digest(a=a, b=b, c=torch.zeros(0)),
    ]
    assert len({told, *others}) == 1 + len(others)


# what is refused


def damaged(change: Callable[[dict[str, torch.Tensor]], object]) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        tensors = load_file(path)
        change(tensors)
        save_file(tensors, path)

    return spoil


def first_weight(tensors: dict[str, torch.Tensor]) -> str:
    return next(name for name in tensors if name != OCCUPIED)


SPOILT: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(), "this checkpoint is missing"),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "this checkpoint is missing"),
    "empty": (lambda path: path.write_bytes(b""), "not a checkpoint of nerf"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:-1]), "not a checkpoint of nerf"),
    "longer": (lambda path: path.write_bytes(path.read_bytes() + b"\0"), "not a checkpoint of nerf"),
    "a pickle": (lambda path: path.write_bytes(pickle.dumps({"a": 1})), "not a checkpoint of nerf"),
    "a tensor less": (damaged(lambda found: found.pop(first_weight(found))), "not a checkpoint of nerf"),
    "a tensor more": (damaged(lambda found: found.update(more=torch.ones(1))), "not a checkpoint of nerf"),
    "another shape": (damaged(lambda found: found.update({first_weight(found): torch.ones(3)})), "size mismatch"),
    "not finite": (damaged(lambda found: found[first_weight(found)].fill_(float("nan"))), "not finite"),
    "no mask": (damaged(lambda found: found.pop(OCCUPIED)), "occupancy grid"),
    "another mask": (damaged(lambda found: found.update({OCCUPIED: torch.ones(4, 4, 4, dtype=torch.bool)})), "grid of"),
    "a mask of floats": (damaged(lambda found: found.update({OCCUPIED: found[OCCUPIED].float()})), "float32"),
}


@pytest.fixture(scope="module")
def nerf() -> Learner:
    return CASES["nerf"]()


@pytest.mark.parametrize("wrong", SPOILT)
def test_what_is_no_checkpoint_of_this_method_is_refused(wrong: str, nerf: Learner, tmp_path: Path) -> None:
    spoil, said = SPOILT[wrong]
    path = tmp_path / "one.safetensors"
    save_checkpoint(nerf, path)
    spoil(path)
    after = fresh(nerf)
    with pytest.raises(InputError, match=said) as caught:
        load_checkpoint(after, path, STEPS)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
