"""Which library is tried, and that a dying probe takes nothing with it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from scenes.files.errors import InputError
from scenes.rendering import variant


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("DRJIT_LIBLLVM_PATH", variant.FORCE, variant.PROBED):
        monkeypatch.delenv(name, raising=False)
    kept = (variant.probe, variant._choose)
    for answer in kept:
        answer.cache_clear()
    yield
    for answer in kept:
        answer.cache_clear()


@pytest.mark.parametrize(
    ("path", "version"),
    [
        *(("libLLVM-15.so.1", 15), ("libLLVM-14.0.6.so.1", 14), ("libLLVM.so.19.1", 19), ("libLLVM-19.so", 19)),
        ("opt/llvm@17/lib/libLLVM.dylib", 17),
        ("usr/lib/llvm-18/lib/libLLVM.so", 18),
        ("usr/lib64/llvm21/lib64/libLLVM.so", 21),
        ("libLLVM.20.dylib", 20),
        ("libLLVM.so", None),
    ],
)
def test_the_version_is_read_from_the_path(path: str, version: int | None) -> None:
    assert variant.llvm_version(Path("/somewhere") / path) == version


def test_scalar_is_the_fallback_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    monkeypatch.setattr(variant, "llvm_libraries", lambda: [Path("/bad")])
    monkeypatch.setattr(variant, "probe", lambda name, library: "it died")
    chosen = variant.choose_variant()
    assert chosen.name == "scalar_rgb"
    assert "llvm_ad_rgb failed with /bad (it died)" in chosen.why
    assert "no CUDA driver" in chosen.why


def test_a_forced_variant_that_fails_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "llvm_libraries", list)
    monkeypatch.setenv(variant.FORCE, "llvm_ad_rgb")
    with pytest.raises(InputError, match="libLLVM of version 16"):
        variant.choose_variant()
    assert variant.choose_variant("scalar_rgb").name == "scalar_rgb"


@pytest.mark.parametrize(
    ("code", "message"), [("import os; os.abort()", "killed by signal 6"), ("import time; time.sleep(60)", "no answer")]
)
def test_an_abort_kills_the_probe_alone_and_one_that_hangs_is_given_up(
    monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    monkeypatch.setattr(variant, "_PROBE", code)
    monkeypatch.setattr(variant, "PROBE_SECONDS", 60.0 if "abort" in code else 0.5)
    assert message in (variant.probe("llvm_ad_rgb", "/lib") or "")


def test_a_library_that_is_no_llvm_fails_the_probe_and_scalar_really_renders(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so.19.1").write_bytes(b"not a library")
    assert variant.probe("llvm_ad_rgb", str(tmp_path / "libLLVM.so.19.1"))
    assert variant.probe("scalar_rgb", "") is None


def test_a_child_does_not_probe_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "_PROBE", "raise SystemExit('probed')")
    chosen = variant.Variant("llvm_ad_rgb", "/lib/libLLVM.so.19.1", "")
    for name, value in chosen.environment().items():
        monkeypatch.setenv(name, value)
    assert variant.probe("llvm_ad_rgb", "/lib/libLLVM.so.19.1") is None
    assert variant.probe("llvm_ad_rgb", "/other") == "probed"
