"""LPIPS by weights that the test makes: by hand on a network that passes one channel on, and by its invariants."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from harness.command.main import main
from harness.records.cells import read_cells
from harness.training.scoring.lpips import NETWORKS, SCALE, SHIFT, SMALLEST, Lpips, lpips_of
from scenes.files.errors import InputError
from tests.harness.ball import write_ball
from tests.harness.shell import refused
from tests.harness.trained_runs import in_this_process


def weights(seed: int = 0, network: str = "alex") -> dict[str, Tensor]:
    """Return random weights under the names of the package `lpips`, with an additional one that it also stores."""
    random = torch.Generator().manual_seed(seed)
    found = {"scaling_layer.shift": torch.zeros(1, 3, 1, 1)}
    for place, stage in enumerate(NETWORKS[network]):
        for name, shape in stage.convolutions:
            found[f"{name}.weight"] = torch.randn(shape, generator=random) / float(np.prod(shape[1:])) ** 0.5
            found[f"{name}.bias"] = 0.1 * torch.randn(shape[0], generator=random)
        found[f"lin{place}.model.1.weight"] = torch.rand(1, shape[0], 1, 1, generator=random)
    return found


def saved(folder: Path, changed: dict[str, Tensor] | None = None, seed: int = 0, network: str = "alex") -> Path:
    file = folder / "lpips.safetensors"
    save_file({**weights(seed, network), **(changed or {})}, file)
    return file


@pytest.fixture(scope="module")
def distance(tmp_path_factory: pytest.TempPathFactory) -> Lpips:
    return Lpips(saved(tmp_path_factory.mktemp("weights")))


def picture(seed: int, size: int = 40) -> np.ndarray:
    return np.random.default_rng(seed).random((size, size, 3))


def test_the_same_image_is_at_no_distance_and_distances_are_symmetric(distance: Lpips) -> None:
    first, second = picture(0), picture(1)
    assert distance(first, first) == 0.0
    assert distance(first, second) == pytest.approx(distance(second, first), rel=1e-5)


def test_a_first_layer_by_hand(tmp_path: Path) -> None:
    """Only the first layer counts, and of its filters two: the mean of red, and a constant 1."""
    changed = {name: torch.zeros_like(value) for name, value in weights().items()}
    changed["net.slice1.0.weight"][0, 0] = 1.0 / 121.0
    changed["net.slice1.0.bias"][:2] = torch.tensor([3.0, 1.0])
    changed["lin0.model.1.weight"][0, :2] = torch.tensor([2.0, 5.0]).reshape(2, 1, 1)
    distance = Lpips(saved(tmp_path, changed))
    size, pad = 33, 2

    def features(image: np.ndarray) -> np.ndarray:
        red = (2.0 * image[..., 0] - 1.0 - SHIFT[0]) / SCALE[0]
        red = np.pad(red, pad)
        count = (size + 2 * pad - 11) // 4 + 1
        means = [[red[4 * i : 4 * i + 11, 4 * j : 4 * j + 11].mean() + 3.0 for j in range(count)] for i in range(count)]
        raw = np.stack([np.maximum(means, 0.0), np.ones((count, count))])
        return raw / (np.sqrt((raw**2).sum(axis=0)) + 1e-10)

    first, second = picture(3, size), picture(4, size)
    squares = (features(first) - features(second)) ** 2
    expected = (2.0 * squares[0] + 5.0 * squares[1]).mean()
    assert distance(first, second) == pytest.approx(expected, rel=1e-4)


def test_vgg_is_known_by_its_weights_and_is_the_network_of_its_paper(tmp_path: Path) -> None:
    """Configuration D of Simonyan and Zisserman 2015, as a sequence of layers numbered as in torchvision."""
    state = weights(1, "vgg")
    layers: list[torch.nn.Module] = []
    channels, ends = 3, []
    for width, many in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        for _ in range(many):
            layers += [torch.nn.Conv2d(channels, width, 3, padding=1), torch.nn.ReLU()]
            channels = width
        ends.append(len(layers) - 1)
        layers.append(torch.nn.MaxPool2d(2))
    names = {key.split(".")[2]: key.rsplit(".", 1)[0] for key in state if key.startswith("net.")}
    for number, name in names.items():
        layer = layers[int(number)]
        layer.load_state_dict({part: state[f"{name}.{part}"] for part in ("weight", "bias")})
    assert len(names) == 13

    def features(image: np.ndarray) -> list[Tensor]:
        x = torch.from_numpy(image).float().permute(2, 0, 1)[None]
        x = (2.0 * x - 1.0 - torch.tensor(SHIFT).reshape(3, 1, 1)) / torch.tensor(SCALE).reshape(3, 1, 1)
        found = []
        for number, layer in enumerate(layers):
            x = layer(x)
            if number in ends:
                found.append(x / x.norm(dim=1, keepdim=True).clamp(min=1e-10))
        return found

    first, second, expected = picture(3, 48), picture(4, 48), 0.0
    with torch.no_grad():
        for place, (a, b) in enumerate(zip(features(first), features(second), strict=True)):
            expected += float(((a - b) ** 2 * state[f"lin{place}.model.1.weight"]).sum(dim=1).mean())
    distance = Lpips(saved(tmp_path, seed=1, network="vgg"))
    assert distance.network == "vgg"
    assert distance(first, second) == pytest.approx(expected, rel=1e-4)


def test_too_small_a_picture_has_none(distance: Lpips) -> None:
    assert distance(picture(0, SMALLEST), picture(1, SMALLEST)) is not None
    assert distance(picture(0, SMALLEST - 1), picture(1, SMALLEST - 1)) is None


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("net.slice1.0.weight", torch.zeros(64, 3, 3, 3), r"net.slice1.0.weight is \(64, 3, 3, 3\)"),
        ("lin4.model.1.weight", torch.full((1, 256, 1, 1), float("nan")), "not finite numbers"),
    ],
)
def test_other_weights_are_refused(tmp_path: Path, name: str, value: Tensor, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Lpips(saved(tmp_path, {name: value}))


@pytest.mark.parametrize("content", [b"", b"no weights", None])
def test_what_is_no_file_of_weights_is_refused(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "w.safetensors").write_bytes(content)
    with pytest.raises(InputError, match=r"w\.safetensors: cannot be read"):
        Lpips(tmp_path / "w.safetensors")


def test_a_run_is_scored_with_them_and_not_gone_on_with_by_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    ball, out = write_ball(tmp_path / "ball", size=32, train=4, test=2), tmp_path / "run"
    file = saved(tmp_path)
    call = ["run", "--profile", "smoke", "--view-set", str(ball), "--methods", "nerf", "--budget-steps", "3"]
    call += ["--workers", "1", "--quiet", "--device", "cpu", "--out", str(out), "--lpips", str(file)]
    assert main([*call, "--seeds", "1"]) == 0
    (cell,) = read_cells(out)
    assert cell.scores["lpips"] == pytest.approx(float(np.mean([view.lpips for view in cell.views])))
    assert cell.provenance["lpips"] == lpips_of(file).digest
    saved(tmp_path, seed=1)
    lpips_of.cache_clear()
    assert "not the weights" in refused(capsys, *call[1:], "--seeds", "2", "--resume")
