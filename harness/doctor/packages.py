"""Python and the packages: what is installed against what `pyproject.toml` pins."""

import platform
import re
import shutil
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from harness.doctor.finding import Finding

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
RENEW = "start it through nox, which installs the pinned ones, or install the one that pyproject.toml names"


def python_findings() -> list[Finding]:
    wanted = str(_project()["project"]["requires-python"]).removeprefix(">=")
    here = platform.python_version()
    if _numbers(here) < _numbers(wanted):
        return [Finding("Python", here, "missing", f"install Python {wanted} or newer", needed=True)]
    return [Finding("Python", f"{here} on {platform.system()} {platform.machine()}")]


def package_findings() -> list[Finding]:
    """The packages that a run needs: one line where all are as pinned, else a line each."""
    pins = pinned(_project()["project"]["dependencies"])
    findings = [_against_pin(name, pin, needed=True) for name, pin in pins.items()]
    odd = [finding for finding in findings if finding.verdict != "ok"]
    good = Finding("packages", f"{len(findings) - len(odd)} of {len(findings)} as pinned")
    return [good, *odd]


def optional_findings() -> list[Finding]:
    """What has a command of its own and nothing else needs."""
    project = _project()
    extras = project["project"].get("optional-dependencies", {})
    found = []
    for extra, purpose in EXTRAS.items():
        for name, pin in pinned(extras.get(extra, [])).items():
            one = _against_pin(name, pin, needed=False)
            if one.verdict == "missing":
                one = Finding(one.what, "not installed", "missing", f"only for {purpose}: install {name}=={pin}")
            found.append(one)
    return found


EXTRAS = {"ray": "--executor ray", "tensorboard": "--tensorboard"}
"""Extra of `pyproject.toml` → the option that needs it."""


def tool_findings() -> list[Finding]:
    """Programs that are called by name."""
    found = []
    for names, purpose, to_do in TOOLS:
        path = next(filter(None, map(shutil.which, names)), None)
        if path is None:
            found.append(Finding(names[0], "not found", "limited", f"{purpose}: {to_do}"))
        else:
            found.append(Finding(names[0], Path(path).name))
    return found


TOOLS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("nox",), "`nox -s …` makes the environments", 'python -m pip install "nox[uv]"'),
    (("uv",), "nox makes its environments with it", 'python -m pip install "nox[uv]"'),
    (("git",), "records name their commit by it", "install git"),
    (
        ("chromium", "chromium-browser", "google-chrome"),
        "tests of the pages in a browser are skipped without it",
        "install it (Debian: apt install chromium)",
    ),
)
"""Names to try · what it is for · what to do."""


def pinned(requirements: list[str]) -> dict[str, str]:
    """Name → version of `name==version`."""
    found = (re.match(r"\s*([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;]+)", one) for one in requirements)
    return {match.group(1): match.group(2) for match in found if match}


def _against_pin(name: str, pin: str, needed: bool) -> Finding:
    try:
        here = version(name)
    except PackageNotFoundError:
        return Finding(name, "not installed", "missing", f"{RENEW}: {name}=={pin}", needed=needed)
    if here.partition("+")[0] != pin:  # a local part is the build, as in 2.15.0+cpu
        return Finding(name, here, "limited", f"{pin} is what was tested; {RENEW}")
    return Finding(name, here)


def _project() -> dict[str, Any]:
    return tomllib.loads(PROJECT.read_text(encoding="utf-8"))


def _numbers(version_text: str) -> list[int]:
    return [int(part) for part in re.findall(r"\d+", version_text)[:3]]
