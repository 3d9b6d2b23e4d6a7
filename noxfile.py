"""nox -s benchmark · view · film · evidence · stability · speed · gate · tests · tests_slow · lint; uv makes their
environments.
"""

import time

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ["lint", "tests"]

PROJECT = nox.project.load_toml("pyproject.toml")


def install(session: nox.Session, *groups: str) -> None:
    """The pinned dependencies of the project and of the named groups."""
    session.install(*PROJECT["project"]["dependencies"], *nox.project.dependency_groups(PROJECT, *groups))


@nox.session
def benchmark(session: nox.Session) -> None:
    """Train the methods side by side and write the report; options as in `python -m harness run --help`."""
    install(session)
    # a diverged cell (3) is part of the result: the report is written, and says 3 in its turn
    session.run("python", "-m", "harness", "run", *session.posargs, success_codes=[0, 3])
    if not {"--dry-run", "--help", "-h"} & set(session.posargs):
        session.run("python", "-m", "reports", out_folder(session.posargs))


@nox.session
def view(session: nox.Session) -> None:
    """Look at a finished run in the browser; options as in `python -m harness view --help`."""
    install(session)
    session.run("python", "-m", "harness", "view", *session.posargs, success_codes=[0, 130])


@nox.session
def film(session: nox.Session) -> None:
    """A camera path through a finished run; options as in `python -m harness render --help`."""
    install(session)
    session.run("python", "-m", "harness", "render", *session.posargs)


@nox.session
def evidence(session: nox.Session) -> None:
    """The studies that a verdict rests on; options as in `python -m harness evidence --help`."""
    measured(session, "evidence", not_for_a_report={"--list"})


@nox.session
def stability(session: nox.Session) -> None:
    """Try the catalogue of stiff and extreme cases; options as in `python -m harness stability --help`."""
    measured(session, "stability", not_for_a_report={"--list"})


@nox.session
def speed(session: nox.Session) -> None:
    """Measure how fast this machine trains and renders; options as in `python -m harness speed --help`."""
    measured(session, "speed")


def measured(session: nox.Session, command: str, not_for_a_report: set[str] | None = None) -> None:
    """A command that writes its figures to a folder, and the page about them."""
    install(session)
    if {"--help", "-h", *(not_for_a_report or ())} & set(session.posargs):
        session.run("python", "-m", "harness", command, *session.posargs)
        return
    out = given_out(session.posargs)
    fresh = [] if out else ["--out", f"out/{command}-{time.strftime('%Y%m%d-%H%M%S')}"]
    # what failed (3) is part of the result: the page is written, and says 3 in its turn
    session.run("python", "-m", "harness", command, *session.posargs, *fresh, success_codes=[0, 3])
    session.run("python", "-m", "reports", out or fresh[1])


@nox.session
def gate(session: nox.Session) -> None:
    """Hold this code to the reviewed limits in gates/; options as in `python -m harness gate --help`."""
    install(session)
    session.run("python", "-m", "harness", "gate", *session.posargs)


@nox.session
def tests(session: nox.Session) -> None:
    """The test suite without its slow part."""
    install(session, "test")
    session.run("pytest", "-n", "auto", *(session.posargs or ["-m", "not slow"]))


@nox.session
def tests_slow(session: nox.Session) -> None:
    """The slow part of the test suite: whole runs, browsers, measurements from end to end."""
    install(session, "test")
    session.run("pytest", "-n", "auto", "-m", "slow", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Style and types."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


def out_folder(options: list[str]) -> str:
    """The folder that the run wrote: `--out`, else what `out/latest` names."""
    return given_out(options) or "out/latest"


def given_out(options: list[str]) -> str | None:
    """The value of `--out`."""
    for index, option in enumerate(options):
        if option == "--out" and index + 1 < len(options):
            return options[index + 1]
        if option.startswith("--out="):
            return option.removeprefix("--out=")
    return None
