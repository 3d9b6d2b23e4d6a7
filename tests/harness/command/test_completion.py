"""The completion scripts in real shells: commands, options, scenes, methods and profiles."""

import shutil
import subprocess
from functools import cache

import pytest

from harness.command.machine_commands import SHELLS, script
from harness.command.main import COMMANDS, main, parser

ASK = """
{script}
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_shtab_harness
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@cache
def bash_script() -> str:
    return script("bash", parser())


def run_bash(text: str) -> str:
    """Return what bash prints."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    done = subprocess.run([bash, "--norc", "-c", text], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize(
    ("words", "some", "none"),
    [
        ("harness ''", ["run", "doctor", "study", "view"], ["--methods"]),
        ("harness do", ["doctor"], ["run"]),
        ("harness run --tens", ["--tensorboard"], ["--seeds"]),
        ("harness run --scenes l", ["lego"], ["hotdog"]),
        ("harness run --methods nerf qnerf_t", ["qnerf_theorem"], ["nerf"]),
        ("harness run --device c", ["cpu", "cuda"], ["auto"]),
        ("harness study conformance voxels", ["voxels_drjit"], ["nerf"]),
    ],
)
def test_bash_completes(words: str, some: list[str], none: list[str]) -> None:
    completions = set(run_bash(ASK.format(script=bash_script(), words=words)).split())
    assert set(some) <= completions
    assert not set(none) & completions


def test_the_function_is_completed_and_runs_the_module() -> None:
    printed = run_bash(f'{bash_script()}\ncomplete -p harness\npython() {{ echo "$@"; }}\nharness run "a b"')
    assert printed.splitlines() == ["complete -o bashdefault -F _shtab_harness harness", "-m harness run a b"]


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_gets_a_script_with_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    for command in COMMANDS:
        assert command in text
