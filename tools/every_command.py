"""Run every nox session and every command in its shortest form: `nox -s commands`, which `.ci/run` runs.

A new session or command needs a line of `TYPED`; `tests/docs/test_documentation.py` fails if it is missing. Sessions
and the first command of each package are started as typed. Further commands are forked from a process that has imported
their packages, as the imports take longer than most commands.
"""

import multiprocessing
import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
SECONDS = 600.0
"""A command that takes longer hangs."""

# Blocks run in parallel, the lines of a block in order. `→ 3`: this exit code is accepted too, as figures mean nothing
# at these sizes.
TYPED = """
nox -s benchmark -- --profile smoke --scenes lego --seeds 2 --budget-steps 12 --tensorboard --out {here}/run {sets}
nox -s film -- {here}/run --path orbit --scenes lego --frames 1 --resolution 16 {sets}
nox -s view -- {here}/run --no-browser --port 0 {sets} → 130
python -m reports {here}/run --partial --export {here}/all.zip
nox -s evidence -- --studies ceilings --quick --out {here}/run {sets} → 3
python -m harness compare {here}/run {here}/run
python -m harness study serving {here}/run --methods qnerf --width 16 --quick {sets}
python -m harness tensorboard {here}/run
python -m scenes render hotdog --resolution 16 --train 3 --test 1 --spp-train 2 --spp-test 2 {ceilings} {sets}
python -m scenes export {here}/sets/{set} --format blender --out {here}/blender
python -m harness score {here}/blender/test --view-set {here}/blender --method me {score} --to {here}/scores.json
python -m scenes export {here}/sets/{set} --format nerfstudio --out {here}/nerfstudio
python -m scenes export {here}/sets/{set} --format npz --out {here}/tiny.npz
python -m harness run --profile smoke --view-set {here}/blender {tiny} {region} --out {here}/foreign
python -m reports {here}/run {here}/foreign --page {here}/outputs.html
python -m reports {here}/foreign --publish {here}/published
python -m harness run --profile smoke --view-set {here}/nerfstudio {here}/tiny.npz --dry-run
python -m harness run --profile smoke --view-set {here}/blender {tiny} {scored} --out {here}/scored
python -m scenes render --scene-file docs/examples/my_scene.py --resolution 16 --train 2 --test 1 {sets}
python -m harness run --profile smoke --scene-file docs/examples/my_scene.xml {tiny} {claim} --out {here}/own {sets}
python -m harness run --profile smoke --scenes lego --methods splats --seeds 1 {few} --out {here}/splats {sets}
python -m harness splats {here}/splats --scene lego --to {here}/lego.ply
python -m scenes noise {here}/sets/{set} --repeats 1
python -m scenes repeats {here}/repeats lego --resolution 8 --spp 2 --count 2
python -m scenes sheet {here}/sheet.png lego --resolution 16 --spp 2
nox -s stability -- --cases E1 --quick --out {here}/stability {sets} → 3
python -m harness study sweep --profile smoke --scenes lego --methods nerf --seeds 1 {few} --out {here}/s.json {sets}
python -m harness study omissions --profile smoke --scenes lego {tiny} --out {here}/left.json {sets} → 3

nox -s frontier -- {one} --methods nerf splats --budgets 0.3 --seeds 1 --resolution 16 --out {here}/f {sets}
python -m harness frontier --pick lego --seconds 1 --out {here}/f
nox -s speed -- --items 2 --quick --out {here}/speed {other_sets}
nox -s conformance -- qnerf
nox -s endurance -- --kills 4 --typed-kills 0 --seed 1 --no-damage --brief --scratch {here}/endurance
nox -s fuzz -- -n 0 --collect-only -q
nox -s tests_thorough -- --collect-only -q tests/harness/studies/speed
nox -s tests_oldest -- --collect-only -q tests/harness/plan
python -m harness gate --only fairness.first_weights fairness.batches --out {here}/gate
python -m harness history {here}/history.jsonl --out {here}/history
python -m harness run --profile smoke --scenes lego {tiny} --executor submitit {job} --out {here}/jobs {other_sets}
python -m harness gate --list
python -m harness study evidence --list
python -m harness study stability --list
python -m harness study conformance --list
python -m harness study families --quick --out {here}/families.json {other_sets}
python -m harness study constants --profile smoke --scenes lego {tiny} --out {here}/constants.json {other_sets}
nox -s judge -- docs/examples/nerfbaselines-blender.csv --out {here}/judgement
nox -s judge -- docs/examples/own-seeds.csv --baseline nerf --metric psnr ssim --out {here}/judgement-2
python -m harness doctor
"""
FILLED = {
    "{tiny}": "--methods nerf --seeds 2 --budget-steps 4 --resolution 16",
    "{claim}": '--claim "nerf>=9dB" --workers 1',
    "{few}": "--budget-steps 4 --resolution 16",
    "{job}": "--job timeout_min=9 --workers 1 --threads 1 --device cpu",
    "{one}": "--studies error_against_time needs --scenes lego",
    "{score}": "--seconds 9 --as-they-are",
    "{scored}": "--checkpoints 2 --curve-views 1 --test-views 1 --workers 1",
    "{region}": "--bounds -2 -2 -2 2 2 2 --near 2 --far 7 --optimiser adam --workers 1",
    "{ceilings}": "--val 1 --ceiling-train 20 --ceiling-val 20 --ceiling-test 20",
}

TYPED_ONCE: set[str] = set()
"""The packages that were started as they are typed."""
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    ["torch", "mitsuba", "colour", "pandas", "harness.command.main", "harness.execution.run", "reports.run.turn"]
)


def blocks(here: str) -> list[list[str]]:
    """Return the lines of each block, with folders filled in."""
    sets = f"--view-sets {here}/sets"
    filled = TYPED
    for name, words in (*FILLED.items(), ("{other_sets}", f"{sets}-2"), ("{sets}", sets)):
        filled = filled.replace(name, words)
    return [block.strip().replace("{here}", here).splitlines() for block in filled.split("\n\n")]


def run(line: str, nox: str, here: Path) -> str:
    """Return what went wrong, or an empty text."""
    typed, _, also = line.partition(" → ")
    if "{set}" in typed:
        typed = typed.replace("{set}", next(folder.name for folder in (here / "sets").glob("hotdog*")))
    words = shlex.split(typed)
    began = time.monotonic()
    with tempfile.NamedTemporaryFile("w+", dir=here) as printed:
        if words[0] == "python" and words[2] in TYPED_ONCE:
            code, wrong = forked(words[2], words[3:], printed.name), ""
        else:
            TYPED_ONCE.add(words[2])
            code, wrong = started(words, nox, printed.fileno())
        printed.seek(0)
        text = printed.read()
    if also and "nox > Command" in text and f"failed with exit code {also}" in text:  # which nox turns into 1
        code = int(also)
    if code not in (0, int(also or 0)):
        wrong = wrong or f"exit code {code}"
    if "Traceback" in text:
        wrong += " with a traceback"
    sys.stdout.write(f"{time.monotonic() - began:5.1f} s  {typed}\n")
    sys.stdout.flush()
    return wrong and f"{typed}: {wrong}\n{text[-3000:]}"


def started(words: list[str], nox: str, printed: int) -> tuple[int, str]:
    """Run a typed command; return its exit code and what else went wrong."""
    python = [nox, "-m", "nox", "--no-venv", "--no-install"] if words[0] == "nox" else [sys.executable]
    process = subprocess.Popen([*python, *words[1:]], cwd=ROOT, stdout=printed, stderr=printed, start_new_session=True)
    wrong = open_viewer(process, printed) if "view" in words else ""
    try:
        return process.wait(SECONDS), wrong
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.wait(), f"took more than {SECONDS:g} s"


def forked(package: str, arguments: list[str], printed: str) -> int:
    """Run `python -m PACKAGE ARGUMENTS` in a fork; return its exit code, that of SIGKILL if it took too long."""
    process = FORKS.Process(target=as_main, args=(package, arguments, printed))
    process.start()
    process.join(SECONDS)
    if process.exitcode is None and process.pid is not None:
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    return -signal.SIGKILL if process.exitcode is None else process.exitcode


def as_main(package: str, arguments: list[str], printed: str) -> None:
    os.setsid()
    file = os.open(printed, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(file, stream)
    sys.argv = [package, *arguments]
    runpy.run_module(package, run_name="__main__", alter_sys=True)


def open_viewer(process: subprocess.Popen[bytes], printed: int) -> str:
    """Open the page that a viewer announces, then press Ctrl-C; return what went wrong, or an empty text."""
    until, address = time.monotonic() + SECONDS, None
    while address is None and process.poll() is None and time.monotonic() < until:
        time.sleep(0.2)
        address = re.search(rb"http://\S+/", os.pread(printed, 1 << 20, 0))
    try:
        if address is None:
            return "announced no page"
        with urllib.request.urlopen(address[0].decode(), timeout=60) as page:
            return "" if b'id="panels"' in page.read() else "is no viewer's page"
    except OSError as error:
        return f"its page cannot be opened: {error}"
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)


def main(nox: str) -> int:
    """Run all blocks with `nox`, the Python that has nox; return 1 if a command went wrong."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="commands-") as folder, ThreadPoolExecutor() as pool:
        both = blocks(folder)
        done = pool.map(lambda block: [run(line, nox, Path(folder)) for line in block], both)
        wrong = [message for block in done for message in block if message]
    sys.stdout.write("\n".join([*wrong, f"{len(wrong)} wrong; {time.monotonic() - began:.0f} s\n"]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
