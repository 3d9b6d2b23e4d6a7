"""The class of the processor, by which speeds are stored."""

import platform

import pytest
import torch

from harness.machine.processor_class import class_here


@pytest.mark.parametrize(
    ("capability", "machine", "named"),
    [
        ("AVX2", "x86_64", "avx2"),
        ("AVX512", "AMD64", "avx512"),
        ("NO AVX", "x86_64", "default"),
        ("DEFAULT", "aarch64", "aarch64_default"),
    ],
)
def test_a_class_is_named_by_its_instructions(
    capability: str, machine: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    assert class_here() == named
