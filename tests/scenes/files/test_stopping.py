"""A signal ends a command during any work of its main thread, and its child processes. A trial tells how code ends its
process, shows nothing that it prints, and leaves no process behind.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from scenes.files.stopping import STOPPED
from scenes.files.trial import how_it_ends

ROOT = Path(__file__).parents[3]
LONG = """
while True:
    try:
        print(SAID, flush=True)
        hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)
    except KeyboardInterrupt:  # before it got there
        pass
"""
"""Half an hour in a library that no signal reaches, after a line of output."""
LATE = "interrupted: what is finished is kept; give the command again"


@contextmanager
def python(code: str, in_order: float = 0.05) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Yield a process and its first line of output; at the end it and its children are killed."""
    first = f"import hashlib; import scenes.files.stopping as s; s.IN_ORDER_SECONDS = {in_order}"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{first}\n{code}"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=open_to_ctrl_c,
    )  # fmt: skip
    with process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline()
        finally:
            with suppress(ProcessLookupError):  # no process is left, as intended
                os.killpg(process.pid, signal.SIGKILL)


def open_to_ctrl_c() -> None:
    """A test run in the background of a shell ignores SIGINT, and its children inherit that."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_library_that_is_at_work_for_long_is_ended(number: signal.Signals) -> None:
    with python(f"s.stop_on_signals(); SAID = 'ready'\n{LONG}") as (process, _):
        process.send_signal(number)
        _, message = process.communicate(timeout=60)
    assert process.returncode == STOPPED
    assert message.startswith(LATE)
    assert message.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("harness run --dry-run", "harness.command.plan_options.planned"),
        ("reports out", "reports.data.studies_load.find_studies"),
        ("scenes render lego", "scenes.rendering.store.ensure_view_set"),
    ],
)
def test_every_command_is_ended_whatever_library_is_at_work(command: str, work: str) -> None:
    """`work` is what the command calls, here half an hour of a library."""
    module, _, name = work.rpartition(".")
    long = LONG.replace("\n", "\n    ")
    code = f"""
import runpy, sys, {module}
def work(*_, **__):
    SAID = 'ready'
    {long}
{module}.{name} = work
sys.argv = {command.split()!r}
runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
"""
    with python(code) as (process, ready):
        assert ready == "ready\n"
        process.send_signal(signal.SIGTERM)
        _, message = process.communicate(timeout=60)
    assert process.returncode == STOPPED
    assert message.startswith(LATE)


@pytest.mark.skipif(not Path(f"/proc/self/task/{os.getpid()}/children").exists(), reason="children are not told here")
def test_what_was_started_does_not_outlive_it() -> None:
    sleeper = "import subprocess; s.stop_on_signals(); SAID = subprocess.Popen(['sleep', '1000']).pid"
    with python(f"{sleeper}\n{LONG}") as (process, number):
        os.kill(int(number), 0)  # it is there
        process.send_signal(signal.SIGTERM)
        # its end of the pipes is closed as well, else this waits for it
        process.communicate(timeout=60)
        assert process.returncode == STOPPED
        assert is_gone(int(number))


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("print(arguments)", ""),
        ("raise ValueError(3)", ""),
        ("raise SystemExit(3)", ""),
        ("import os; os._exit(0)", "ends the process with exit code 0"),
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


def is_gone(process: int) -> bool:
    """Return whether `process` ends within ten seconds: the kernel ends one after the call that kills it returns."""
    state = Path(f"/proc/{process}/stat")
    for _ in range(500):
        try:
            os.kill(process, 0)
            if ") Z " in state.read_text():  # ended, and nobody has asked for its status
                return True
        except ProcessLookupError:
            return True
        except FileNotFoundError:  # it ended in between, or there is no /proc
            pass
        time.sleep(0.02)
    return False


def test_code_that_does_not_end_is_ended_with_what_it_started(tmp_path: Path) -> None:
    number = tmp_path / "number"
    assert how_it_ends(f"{STAYS}while True: pass", str(number), limit=3.0) == "does not end within 3 s"
    assert is_gone(int(number.read_text()))
    assert how_it_ends(STAYS, str(number)) == ""
    assert is_gone(int(number.read_text()))


def test_it_ends_with_the_process_that_tries_it(tmp_path: Path) -> None:
    number = tmp_path / "number"
    call = f"from scenes.files.trial import how_it_ends; how_it_ends({STAYS + 'while True: pass'!r}, {str(number)!r})"
    trying = subprocess.Popen([sys.executable, "-c", call], cwd=ROOT)
    while not number.exists() or not number.read_text():
        time.sleep(0.02)
    trying.kill()
    trying.wait()
    assert is_gone(int(number.read_text()))
