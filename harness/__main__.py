"""python -m harness COMMAND"""

import sys
from importlib.util import find_spec
from pathlib import Path

OURS = ("scenes", "baselines", "harness", "reports")


def require_ours() -> None:
    """End the process with a line on standard error if Python finds another package in place of one of `OURS`, as with
    `python -m` in a folder that has one of that name.
    """
    root = Path(__file__).resolve().parents[1]
    for name in OURS:
        spec = find_spec(name)
        where = Path(spec.origin).resolve() if spec is not None and spec.origin else None
        if where is None or root not in where.parents:
            sys.stderr.write(
                f"error: {where or name}: is not the package `{name}` of radiance-verdict, and Python finds it first; "
                "rename it, start from another folder, or use the command `radiance-verdict`\n"
            )
            raise SystemExit(2)


if __name__ == "__main__":
    require_ours()
    from harness.command.main import main, run_as_process

    run_as_process(main, sys.argv[1:])
