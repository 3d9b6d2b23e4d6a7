"""The arithmetic that a picture came from is in its key: processor, and every switch of torch."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest
import torch

from harness.machine.provenance import provenance
from harness.playback import keys
from harness.playback.cached import CachedMethod
from harness.playback.keys import switches
from harness.playback.store import ViewStore
from tests.harness.playback.test_view_keys import camera, key, trained
from tests.harness.tiny import CPU


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
    "autocast": lambda: torch.autocast("cuda", torch.float16),
    "products in TF32": lambda: switched(CUDA_PRODUCTS, "fp32_precision", "tf32"),
    "products of high precision": lambda: matmul_precision("high"),
    "cuDNN": lambda: switched(torch.backends.cudnn, "allow_tf32", not torch.backends.cudnn.allow_tf32),
    **{
        name: lambda name=name: switched(CUDA_PRODUCTS, name, not getattr(CUDA_PRODUCTS, name))  # type: ignore[misc]
        for name in ("allow_fp16_reduced_precision_reduction", "allow_bf16_reduced_precision_reduction")
    },
}


@pytest.mark.filterwarnings("ignore:User provided device_type of 'cuda'")
@pytest.mark.parametrize(("on_gpu", "name"), [(False, name) for name in ON_CPU] + [(True, name) for name in ON_CUDA])
def test_every_switch_of_arithmetic_is_in_the_key_whichever_others_were_set(on_gpu: bool, name: str) -> None:
    if on_gpu and name == "autocast" and not torch.cuda.is_available():
        pytest.skip("torch has no autocast for a GPU that is not there")
    before = switches(on_gpu)
    with (ON_CUDA if on_gpu else ON_CPU)[name]():
        assert switches(on_gpu) != before
    assert switches(on_gpu) == before


@pytest.mark.parametrize("name", ON_CPU)
@pytest.mark.parametrize("frozen", [False, True])
def test_under_another_switch_a_view_is_not_found(name: str, frozen: bool) -> None:
    one = CachedMethod(trained(), ViewStore(10**6), 512, frozen)
    one.render(camera())
    with ON_CPU[name]():
        assert one.lookup(camera()) is None
    assert one.lookup(camera()) is not None


def test_another_processor_is_another_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    one = trained()
    before = key(one)
    assert keys.machine(one)["processor"][1] == provenance(CPU)["processor"]
    monkeypatch.setattr(keys, "processor", lambda: "another with the same capability")
    assert key(one) != before
