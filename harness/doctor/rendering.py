"""Mitsuba's variants and the LLVM that they are compiled with, each tried in a process of its own, which may die."""

import ctypes.util
import os

from harness.doctor.finding import Finding
from scenes.variant import OLDEST_LLVM, llvm_libraries, probe

INSTALL_LLVM = f"install the shared library of LLVM {OLDEST_LLVM} or newer (Debian: apt install libllvm19), or name it "
INSTALL_LLVM += "in DRJIT_LIBLLVM_PATH"


def scalar_findings() -> list[Finding]:
    """Which everything works with."""
    failure = probe("scalar_rgb", "")
    if failure is None:
        return [Finding("Mitsuba scalar_rgb", "renders")]
    return [Finding("Mitsuba scalar_rgb", failure, "missing", "reinstall mitsuba as pinned", needed=True)]


def llvm_findings() -> list[Finding]:
    """The newest library that works, and those that do not."""
    found = []
    users = os.environ.get("DRJIT_LIBLLVM_PATH")
    libraries = [str(path) for path in llvm_libraries()]
    if users and users not in libraries:
        to_do = f"name a file of LLVM {OLDEST_LLVM} or newer, or unset it"
        found.append(Finding("DRJIT_LIBLLVM_PATH", f"{users} is no such library", "limited", to_do))
    if not libraries:
        to_do = f"rendering is two to three times as fast with it, and voxels_drjit needs it: {INSTALL_LLVM}"
        return [*found, Finding("Mitsuba llvm_ad_rgb", "no libLLVM was found", "limited", to_do)]
    for library in libraries:
        failure = probe("llvm_ad_rgb", library)
        if failure is None:
            return [*found, Finding("Mitsuba llvm_ad_rgb", f"renders with {library}")]
        found.append(Finding("Mitsuba llvm_ad_rgb", f"{library}: {failure}", "limited", INSTALL_LLVM))
    return found


def cuda_findings() -> list[Finding]:
    """For NVIDIA alone: Dr.Jit has no backend for other GPUs."""
    if not (ctypes.util.find_library("cuda") or ctypes.util.find_library("nvcuda")):
        return [Finding("Mitsuba cuda_ad_rgb", "no CUDA driver", "limited", "nothing: processors render as well")]
    failure = probe("cuda_ad_rgb", "")
    if failure is None:
        return [Finding("Mitsuba cuda_ad_rgb", "renders")]
    return [Finding("Mitsuba cuda_ad_rgb", failure, "limited", "look at the driver; processors render as well")]
