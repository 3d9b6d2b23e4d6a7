"""The origin of a record: the sources and their lines, packages, processor, commit."""

import ast
import hashlib
import io
import os
import platform
import subprocess
import tokenize
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import torch

from harness.machine.device import available_cores, multiplies_bfloat16
from harness.machine.wait_policy import waits_passively
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

OUR_PACKAGES = ("harness", "scenes", "baselines")
"""The packages of this program that a cell needs; they are sent to every node."""
CHECKED = (
    "torch",
    "numpy",
    "numba",
    "llvmlite",
    "drjit",
    "OpenImageIO",
    "flip-evaluator",
    "scipy",
    "safetensors",
    "jaxtyping",
)
"""The libraries on which a cell's bits or scores may depend. Mitsuba is needed only to render view sets."""
PROGRAM = "this program"
"""The key of this program's sources in `versions`."""


def our_folders() -> list[Path]:
    """Return the folder of each of `OUR_PACKAGES`; on a node they may lie anywhere."""
    return [Path(next(iter(import_module(name).__path__))).resolve() for name in OUR_PACKAGES]


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python, `CHECKED` and this program (a digest of its sources), as of the first call."""
    packages = {name: installed(name) for name in CHECKED}
    return {"Python": platform.python_version(), PROGRAM: _digest(), **packages}


@cache
def installed(package: str) -> str:
    """Return the version of a package without importing it; "not installed" if there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def differences(ours: dict[str, str], theirs: dict[str, str]) -> str:
    return ", ".join(
        f"{name} {theirs.get(name, 'unknown')} instead of {value}"
        for name, value in ours.items()
        if theirs.get(name) != value
    )


def changed_since(ours: dict[str, str]) -> str:
    """Return `differences` to this process, with this program's sources read again."""
    return differences(ours, {**versions(), PROGRAM: _digest()})


def _digest() -> str:
    """Return 16 hexadecimal digits that depend on the name and bytes of every Python file of `OUR_PACKAGES`."""
    digest = hashlib.sha256()
    for folder in our_folders():
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.relative_to(folder.parent).as_posix().encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


PARTS: dict[str, tuple[str, ...]] = {
    "encoding": ("numerics/encoding.py",),
    "amplifier": ("amplifiers.py", "numerics/amplifier.py"),
    "network": ("composition.py", "methods/nerf.py", "methods/qnerf.py", "field.py"),
    "rendering": ("numerics/quadrature.py", "numerics/compositing.py", "rendering.py"),
}
"""The files of `baselines` by part: Listing 1; Listing 2 and Eq. 4; Table 1 and Listing 3; Listing 4."""

BASELINES = Path(__file__).parents[2] / "baselines"
RENEWED = "gates"
"""The folder of the references and limits of gates."""
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def source_lines(text: str) -> int:
    """Count the lines of a Python module that hold code; raises `SyntaxError` for other text."""
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in SILENT:
            held |= set(range(token.start[0], token.end[0] + 1))
    return len(held - docstrings)


def core_module_lines() -> dict[str, int]:
    return {
        part: sum(source_lines((BASELINES / name).read_text(encoding="utf-8")) for name in names)
        for part, names in PARTS.items()
    }


PACKAGES = (*CHECKED, "mitsuba", "colour-science")


def provenance(device: torch.device) -> JsonObject:
    """Return versions, processor, device, commit and a digest of the sources; no user names, no paths."""
    return {
        **code_here(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "instruction_set": torch.backends.cpu.get_cpu_capability(),
        "cores": available_cores(),
        "threads": torch.get_num_threads(),
        "waiting": "passive" if waits_passively(os.environ) else "active",
        "device": torch.cuda.get_device_name() if device.type == "cuda" else "cpu",
        "torch_build": f"ROCm {torch.version.hip}" if torch.version.hip else f"CUDA {torch.version.cuda}",
        "bfloat16_products": multiplies_bfloat16(device),
    }


def code_here() -> JsonObject:
    """Return commit, digest of the sources and packages, as of the first call: imported modules do not change."""
    return {
        "commit": commit(),
        "sources": versions()[PROGRAM],
        "packages": {name: installed(name) for name in PACKAGES},
    }


def committed(folder: Path = BASELINES) -> str:
    """Return the commit of `folder`; raises `InputError` without one, or if a file outside `RENEWED` has changed."""

    def git(*words: str) -> str:
        return subprocess.check_output(["git", *words], cwd=folder, stderr=subprocess.DEVNULL, text=True)

    try:
        changed = git("status", "--porcelain", "--", ":/", f":(top,exclude){RENEWED}").splitlines()
        name = git("rev-parse", "--short=12", "HEAD").strip()
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError("--renew: references are of committed code only, and git knows no commit here") from error
    if changed:
        files = ", ".join(line[3:] for line in changed[:3]) + (", …" if len(changed) > 3 else "")
        raise InputError(f"--renew: references are of committed code only; commit or remove {files}")
    return name


@cache
def processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown"


@cache
def commit() -> str:
    """Return the commit, followed by `-dirty` if files were changed since; "unknown" without git."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.check_output(command, cwd=BASELINES, stderr=subprocess.DEVNULL, text=True).strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
