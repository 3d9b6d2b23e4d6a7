"""A trial tells how code ends its process, shows nothing that it prints, and leaves no process behind."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from scenes.files.trial import how_it_ends


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("print(arguments)", ""),
        ("raise ValueError(3)", ""),
        ("raise SystemExit(3)", ""),
        ("import os; os._exit(0)", "ends the process with exit code 0"),
        ("import os; os._exit(7)", "ends the process with exit code 7"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "ends the process with signal 9"),
        ("raise KeyboardInterrupt", "raises KeyboardInterrupt"),
        ("assert arguments == ['one', 'two words']; import os; os._exit(1)", "ends the process with exit code 1"),
    ],
)
def test_how_it_ends(code: str, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert how_it_ends(code, "one", "two words") == message
    assert capfd.readouterr() == ("", "")


STAYS = (
    "import subprocess, sys\n"
    "stays = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
    "open(arguments[0], 'w').write(str(stays.pid))\n"
)


def is_gone(file: Path) -> bool:
    """Return whether the process of that number ends within a few seconds."""
    for _ in range(500):
        try:
            os.kill(int(file.read_text()), 0)
        except ProcessLookupError:
            return True
        except (ValueError, FileNotFoundError):
            pass
        if (state := Path(f"/proc/{file.read_text() or 0}/stat")).exists() and ") Z " in state.read_text():
            return True
        time.sleep(0.02)
    return False


def test_code_that_does_not_end_is_ended_with_what_it_started(tmp_path: Path) -> None:
    number = tmp_path / "number"
    assert how_it_ends(f"{STAYS}while True: pass", str(number), limit=3.0) == "does not end within 3 s"
    assert is_gone(number)
    assert how_it_ends(STAYS, str(number)) == ""
    assert is_gone(number)


def test_it_ends_with_the_process_that_tries_it(tmp_path: Path) -> None:
    number = tmp_path / "number"
    call = f"from scenes.files.trial import how_it_ends; how_it_ends({STAYS + 'while True: pass'!r}, {str(number)!r})"
    trying = subprocess.Popen([sys.executable, "-c", call], cwd=Path(__file__).parents[3])
    while not number.exists() or not number.read_text():
        time.sleep(0.02)
    trying.kill()
    trying.wait()
    assert is_gone(number)
