"""The completion scripts in real shells: commands, options, scenes, methods and profiles."""

import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

from harness.__main__ import OTHERS, main, parser
from harness.completion_options import SHELLS, script

ASK = """
{script}
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_shtab_harness
printf '%s\\n' "${{COMPREPLY[@]}}"
"""

ASK_ZSH = r"""
zmodload zsh/zpty
zpty inner zsh -f -i
zpty -w inner "LISTMAX=0; eval \"\$(<$1)\"; PS1=REA''DY"
zpty -r inner line '*READY*'
zpty -w -n inner "$2"$'\t\t'
zpty -w -n inner $'\C-U'"print EN''D"$'\n'
zpty -r inner line '*END*'
print -r -- "$line"
"""
"""In a shell that nothing was set up in, as on a fresh account: the script, then words and twice Tab at the prompt."""


@cache
def bash_script() -> str:
    return script("bash", parser())


@pytest.mark.parametrize(
    ("words", "some", "none"),
    [
        ("harness ''", ["run", "doctor", "conformance", "view"], ["--methods"]),
        ("harness do", ["doctor"], ["run"]),
        ("harness run --tens", ["--tensorboard"], ["--seeds"]),
        ("harness run --profile re", ["reduced"], ["smoke"]),
        ("harness run --scenes l", ["lego"], ["hotdog"]),
        ("harness run --methods nerf qnerf_t", ["qnerf_theorem"], ["nerf"]),
        ("harness run --device c", ["cpu", "cuda"], ["auto"]),
        ("harness conformance voxels", ["voxels_drjit"], ["nerf"]),
    ],
)
def test_bash_completes(words: str, some: list[str], none: list[str]) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    text = ASK.format(script=bash_script(), words=words)
    done = subprocess.run([bash, "--norc", "-c", text], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    found = done.stdout.split()
    assert set(some) <= set(found)
    assert not set(none) & set(found)


@pytest.mark.parametrize(
    ("line", "some"),
    [
        ("harness do", ["doctor"]),
        ("harness run --sc", ["--scenes", "--scene-file"]),
        ("harness run --scenes l", ["lego"]),
    ],
)
@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_zsh_and_fish_complete(shell: str, line: str, some: list[str], tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    file = tmp_path / "completion"
    file.write_text(script(shell, parser()))
    ask = {
        "zsh": ["zsh", "-f", "-c", ASK_ZSH, "zsh", str(file), line],
        "fish": ["fish", "--no-config", "-c", f"source {file}; complete -C '{line}'"],
    }
    home = {**os.environ, "HOME": str(tmp_path), "ZDOTDIR": str(tmp_path), "TERM": "xterm"}
    done = subprocess.run(ask[shell], capture_output=True, text=True, check=True, env=home)
    assert not set(some) & set(line.split())
    for one in some:
        assert one in done.stdout


def test_harness_is_what_is_completed_and_what_is_run() -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    text = f'{bash_script()}\ncomplete -p harness\npython() {{ echo "$@"; }}\nharness run "a b"'
    done = subprocess.run([bash, "--norc", "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["complete -o bashdefault -F _shtab_harness harness", "-m harness run a b"]


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_gets_a_script_with_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    for command in ("run", "sweep", *OTHERS):
        assert command in text


def test_the_parser_that_is_used_is_left_as_it_was() -> None:
    ours = parser()
    script("bash", ours)
    assert ours.prog == "python -m harness"
    # a choice would refuse with other words than ours, and before a package is looked for
    assert ours.parse_args(["run", "--methods", "no_such"]).methods == ["no_such"]
