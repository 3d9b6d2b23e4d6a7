"""The device of tensors, the processor's class, and the switches that make a run repeatable and its clock honest."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from harness.machine.device import chosen_device, keep_freed_memory, multiplies_bfloat16, processor_flags, use_threads
from harness.machine.processor_class import class_here
from harness.machine.wait_policy import wait_policy, waits_passively
from scenes.files.errors import InputError
from tests.harness.shell import ROOT


@pytest.mark.parametrize(
    ("name", "there", "kind"), [("auto", True, "cuda"), ("auto", False, "cpu"), ("cpu", True, "cpu")]
)
def test_auto_takes_a_gpu_if_there_is_one(name: str, there: bool, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: there)
    assert chosen_device(name).type == kind


@pytest.mark.parametrize(
    ("cuda", "hip", "built"), [("12.8", None, "CUDA 12.8"), (None, "6.4", "ROCm 6.4"), (None, None, "CPU only")]
)
def test_a_missing_gpu_is_reported_with_the_build_of_torch(
    cuda: str | None, hip: str | None, built: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.version, "cuda", cuda)
    monkeypatch.setattr(torch.version, "hip", hip)
    with pytest.raises(InputError) as caught:
        chosen_device("cuda")
    assert f"built for {built}) sees no GPU; use --device cpu" in str(caught.value)


def test_sums_are_repeatable() -> None:
    use_threads(1)
    assert torch.get_num_threads() == 1
    assert torch.are_deterministic_algorithms_enabled()
    assert torch.is_deterministic_algorithms_warn_only_enabled()
    assert not torch.backends.cuda.matmul.allow_tf32
    # deterministic mode would fill each new tensor with NaN, which only costs time
    assert not torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]


def test_a_process_that_trains_does_not_import_the_compiler() -> None:
    code = "import sys; from harness.machine.device import use_threads; use_threads(1); "
    code += "sys.exit('torch._inductor' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_only_matrix_units_make_bfloat16_worth_it(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    assert processor_flags(cpuinfo) == set()
    for flags, has in (("avx512_bf16 amx_tile", False), ("avx512_bf16 amx_bf16 amx_tile", True)):
        cpuinfo.write_text(f"flags : fpu {flags}\n")
        assert ("amx_bf16" in processor_flags(cpuinfo)) == has
    assert multiplies_bfloat16(torch.device("cpu")) == ("amx_bf16" in processor_flags())


def test_memory_is_kept_where_the_c_library_can_and_nothing_fails_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    keep_freed_memory()
    monkeypatch.setattr("ctypes.CDLL", lambda name: object())
    keep_freed_memory()


@pytest.mark.parametrize(
    ("capability", "machine", "named"),
    [
        ("AVX2", "x86_64", "avx2"),
        ("AVX512", "AMD64", "avx512"),
        ("NO AVX", "x86_64", "default"),
        ("DEFAULT", "aarch64", "aarch64_default"),
    ],
)
def test_instructions_name_a_class(capability: str, machine: str, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    assert class_here() == named


@pytest.mark.parametrize(
    ("given", "policy", "passive", "afterwards"),
    [
        ({}, "PASSIVE", False, True),
        ({"OMP_WAIT_POLICY": ""}, "PASSIVE", False, True),
        ({"OMP_WAIT_POLICY": "passive"}, "passive", True, True),
        ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE", False, False),
        ({"GOMP_SPINCOUNT": "0"}, "PASSIVE", True, True),
        ({"GOMP_SPINCOUNT": "1000"}, "PASSIVE", False, False),
    ],
)
def test_threads_wait_passively_unless_the_user_says_otherwise(
    given: dict[str, str], policy: str, passive: bool, afterwards: bool
) -> None:
    assert wait_policy(given) == {"OMP_WAIT_POLICY": policy}
    assert waits_passively(given) is passive
    assert waits_passively({**given, **wait_policy(given)}) is afterwards
