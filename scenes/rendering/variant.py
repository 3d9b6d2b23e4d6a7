"""The Mitsuba variant that this machine can run, determined without importing Mitsuba here.

Dr.Jit's LLVM backend needs the shared library of LLVM 16 or newer; with LLVM 15 the first render aborts the process.
So candidates are tried in separate processes, newest library first.
"""

import ctypes.util
import functools
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from scenes.files.errors import InputError

VARIANTS = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")
"""The variants, fastest first."""
OLDEST_LLVM = 16
FORCE = "HARNESS_MITSUBA_VARIANT"
PROBED = "HARNESS_MITSUBA_PROBED"
"""The variable that tells child processes what a parent has probed already, `variant|library`."""
PROBE_SECONDS = 120.0

LIBRARY_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib64/llvm*/lib*", "/usr/lib",
    "/usr/lib/llvm*/lib", "/usr/local/lib", "/usr/local/opt/llvm*/lib", "/opt/homebrew/opt/llvm*/lib",
    "/opt/local/libexec/llvm*/lib",
)  # fmt: skip

_PROBE = """
import ctypes, os, sys
variant, library = sys.argv[1], sys.argv[2]
if library:
    version = (ctypes.c_uint * 3)()
    llvm = ctypes.CDLL(library)
    if not hasattr(llvm, "LLVMGetVersion"):
        sys.exit("older than LLVM 16")
    llvm.LLVMGetVersion(*(ctypes.byref(version, 4 * i) for i in range(3)))
    if version[0] < 16:
        sys.exit(f"LLVM {version[0]} is older than LLVM 16")
import mitsuba as mi
import numpy as np
mi.set_variant(variant)
scene = mi.load_dict({
    "type": "scene",
    "light": {"type": "constant"},
    "ball": {"type": "sphere", "bsdf": {"type": "roughplastic"}},
    "glass": {"type": "cube", "bsdf": {"type": "dielectric"}},
    "integrator": {"type": "aov", "aovs": "n:sh_normal", "image": {"type": "path", "max_depth": 4}},
    "sensor": {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f().look_at([4, 1, 1], [0, 0, 0], [0, 0, 1]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "pixel_format": "rgba"},
    },
})
image = np.array(mi.render(scene, spp=4))
if not np.isfinite(image).all() or image[4, 4, 3] < 0.9:
    sys.exit("the probe's image is wrong")
print("rendered")
"""


@dataclass(frozen=True)
class Variant:
    name: str
    libllvm: str | None
    """The library that Dr.Jit must load, or None if it needs none."""
    why: str
    """The reason for the user, in one line: the variant, and what excluded the faster ones."""

    def environment(self) -> dict[str, str]:
        """Return the variables for a child process, which then chooses the same variant without probing again."""
        chosen = {FORCE: self.name, PROBED: f"{self.name}|{self.libllvm or ''}"}
        return {**chosen, "DRJIT_LIBLLVM_PATH": self.libllvm} if self.libllvm else chosen


def known_variant(name: str | None) -> str | None:
    """Return the name, or None for `auto`, by default from `HARNESS_MITSUBA_VARIANT`. Raises `InputError`."""
    requested = name or os.environ.get(FORCE) or "auto"
    if requested not in (*VARIANTS, "auto"):
        source = "--variant" if name else FORCE
        raise InputError(f"{source}: unknown Mitsuba variant {requested!r}; known: auto {' '.join(VARIANTS)}")
    return None if requested == "auto" else requested


def choose_variant(name: str | None = None) -> Variant:
    """Return the fastest variant that works here, or the named one, cached. Raises `InputError` if that fails."""
    return _choose(known_variant(name))


@functools.cache
def _choose(wanted: str | None) -> Variant:
    refused: list[str] = []
    for name in VARIANTS if wanted is None else (wanted,):
        if name == "scalar_rgb":
            why = f"scalar_rgb: {'; '.join(refused)}" if refused else "scalar_rgb: asked for"
            return Variant(name, None, why)
        if name == "cuda_ad_rgb":  # needs no separate library
            libraries = [""] if ctypes.util.find_library("cuda") or ctypes.util.find_library("nvcuda") else []
            missing = "no CUDA driver"
        else:
            libraries = [str(path) for path in llvm_libraries()]
            missing = f"no libLLVM of version {OLDEST_LLVM} or newer"
        if not libraries:
            refused.append(f"{name} needs what was not found: {missing}")
        for library in libraries:
            failure = probe(name, library)
            if failure is None:
                return Variant(name, library or None, f"{name}{' with ' + library if library else ''}")
            refused.append(f"{name} failed{' with ' + library if library else ''} ({failure})")
    raise InputError(f"Mitsuba variant {wanted} does not work here: {'; '.join(refused)}; choose auto or scalar_rgb")


def llvm_libraries() -> list[Path]:
    """Return LLVM shared libraries that may be new enough: the user's `DRJIT_LIBLLVM_PATH` first, then newest first."""
    versions: dict[Path, int] = {}
    for pattern in LIBRARY_FOLDERS:
        root = Path(pattern)
        for folder in sorted(Path(root.anchor).glob(str(root.relative_to(root.anchor)))):
            for file in sorted(folder.glob("libLLVM[-.]*")):
                version = llvm_version(file)
                shared = re.search(r"\.(so|dylib|dll)\b", file.name)
                if shared and file.is_file() and (version is None or version >= OLDEST_LLVM):
                    versions.setdefault(file.resolve(), version or OLDEST_LLVM)
    newest_first = sorted(versions, key=lambda file: (-versions[file], str(file)))
    users = os.environ.get("DRJIT_LIBLLVM_PATH")
    if users and Path(users).is_file() and (llvm_version(Path(users)) or OLDEST_LLVM) >= OLDEST_LLVM:
        return [Path(users), *(file for file in newest_first if file != Path(users).resolve())]
    return newest_first


def llvm_version(library: Path) -> int | None:
    """Return the major version from the file's name or folder, links followed; None if neither contains it.

    Names are `libLLVM-15.so.1`, `libLLVM.so.19.1`, `llvm-18/lib/libLLVM.so`, `llvm@17/lib/libLLVM.dylib`.
    """
    for path in (library, library.resolve()):
        for pattern in (r"libLLVM-(\d+)", r"libLLVM\.so\.(\d+)", r"libLLVM\.(\d+)"):
            if named := re.match(pattern, path.name):
                return int(named.group(1))
        if placed := re.search(r"llvm(?:[-@/]|-toolset-)?(\d+)", str(path.parent)):
            return int(placed.group(1))
    return None


@functools.cache
def probe(variant: str, library: str) -> str | None:
    """Render 8 × 8 pixels in a separate process; returns None if that worked, else a short reason."""
    if os.environ.get(PROBED) == f"{variant}|{library}":
        return None
    environment = {**os.environ, **({"DRJIT_LIBLLVM_PATH": library} if library else {})}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE, variant, library], env=environment, capture_output=True, text=True,
            errors="replace", timeout=PROBE_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no answer within {PROBE_SECONDS:.0f} s"
    if done.returncode == 0 and "rendered" in done.stdout:
        return None
    if done.returncode < 0:
        return f"its process was killed by signal {-done.returncode}"
    lines = (done.stderr + done.stdout).split("\n")
    return next((line.strip()[:200] for line in reversed(lines) if line.strip()), f"exit code {done.returncode}")
