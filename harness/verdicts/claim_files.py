"""Claims about methods: those that come with the program, the user's files, and one-line claims.

A file of claims is TOML (`docs/claims.md`). A line reads `mine - nerf >= 1.5 dB on lego`.
"""

import re
import tomllib
from collections.abc import Collection, Sequence
from functools import cache
from pathlib import Path

from msgspec.structs import replace

from harness.records.cells import USUAL, Roles
from harness.records.claims import AXES, QUANTITIES, STATED, Bound, ClaimFile, Number, Statement
from harness.records.json_record import as_promised
from harness.records.metric_table import METRICS
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

PRINTED = Path(__file__).parent / "printed"
BOUNDS: dict[str, Bound] = {">=": "at least", "<=": "at most", "=": ""}
NUMBER = r"[-+]?\d+(?:\.\d+)?"
LINE = re.compile(
    r"(?P<method>[^\s<>=]+)(?:\s+[-−]\s+(?P<against>[^\s<>=]+))?\s*(?P<bound>>=|<=|=)\s*"
    rf"(?P<printed>{NUMBER})\s*(?P<unit>[A-Za-z_]+|%\s*(?:{'|'.join(AXES)}))(?:\s+on\s+(?P<scene>\S+))?"
)
FORM = "METHOD [- METHOD] >= NUMBER dB|METRIC|% steps|% seconds [on SCENE], such as `mine - nerf >= 1.5 dB`"
WORDS = {
    "gain": "{method} − {against}{where}",
    "score": "{method}{where}",
    "saving": "{method} reaches the target in fewer {axis} than {against}",
}
"""Kind of claim → its statement if the claim has none."""
DEFAULTS = {"scene": "all", "metric": "psnr", "axis": "steps"}
PLURAL = {"method": "methods", "against": "methods", "scene": "scenes"}
NOT_RUN = "is not part of this run"
OWN = ("id", "where", "statement", "quantity", "printed", "unit", "bound", "leaves_open")


@cache
def known_claims() -> tuple[ClaimFile, ...]:
    return tuple(read_claims(file) for file in sorted(PRINTED.glob("*.toml")))


def usual_roles() -> Roles:
    """Return the roles of a run that states none: those of the profiles, with the claims of this program."""
    pairs = dict.fromkeys(pair for file in known_claims() for pair in file.pairs)
    return replace(USUAL, claimed=tuple(pairs))


def read_claims(file: Path) -> ClaimFile:
    """Read a file of claims; raises `InputError` that names the file and the claim."""
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{file}: cannot be read as a file of claims ({error}); docs/claims.md has the form"
        ) from error
    rows = data.pop("claim", [])
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{file}: has no [[claim]]; docs/claims.md has the form")
    claims = [_statement(row, place, f"{file}: claim {place}") for place, row in enumerate(rows, start=1)]
    ids = [claim.id for claim in claims]
    if repeated := [name for name in ids if ids.count(name) > 1]:
        raise InputError(f"{file}: two claims have the id {repeated[0]!r}")
    about = dict.fromkeys(claim.of["method"] for claim in claims if "method" in claim.of)
    defaults = {"id": file.stem, "title": file.stem, "methods": list(about)}
    try:
        read = as_promised({**defaults, **data, "claims": []}, ClaimFile)
    except ValueError as error:
        raise InputError(f"{file}: {error}; docs/claims.md has the form") from error
    if unknown := sorted(set(read.principal) - set(ids)):
        raise InputError(f"{file}: principal names {unknown[0]!r}, which is the id of no claim")
    return replace(read, claims=tuple(claims))


def _statement(row: JsonObject, place: int, at: str) -> Statement:
    row = dict(row)
    quantity = row.setdefault("quantity", "gain" if "against" in row else "score")
    if quantity not in QUANTITIES:
        raise InputError(f"{at}: quantity {quantity!r} is unknown; known: {', '.join(QUANTITIES)}")
    of = {name: DEFAULTS[name] for name in QUANTITIES[quantity] if name in DEFAULTS}
    of |= {name: value for name, value in row.items() if name not in OWN}
    if missing := [name for name in QUANTITIES[quantity] if name not in of]:
        raise InputError(f"{at}: {quantity!r} needs {', '.join(missing)}")
    if "metric" in of and of["metric"] not in METRICS:
        raise InputError(f"{at}: metric {of['metric']!r} is unknown; known: {', '.join(METRICS)}")
    if of.get("axis", AXES[0]) not in AXES:
        raise InputError(f"{at}: axis {of['axis']!r} is neither {' nor '.join(AXES)}")
    where = row.get("where", ())
    printed = row.get("printed")
    if isinstance(printed, str):
        bound = re.fullmatch(rf"(>=|<=|=)\s*({NUMBER})", printed.strip())
        if bound is None:
            raise InputError(f'{at}: printed {printed!r} is neither a number, a range nor a bound such as ">= 1.5"')
        row |= {"bound": BOUNDS[bound[1]], "printed": _number(bound[2])}
    row.setdefault("unit", METRICS[of["metric"]].unit if "metric" in of else "%" if "axis" in of else "")
    row.setdefault("id", f"claim-{place}")
    row.setdefault("statement", _usual_statement(quantity, of))
    try:
        fields = {name: row[name] for name in OWN if name in row}
        fields["where"] = (where,) if isinstance(where, str) else where
        return as_promised({**fields, "of": of}, Statement)
    except ValueError as error:
        raise InputError(f"{at}: {error}") from error


def _usual_statement(quantity: str, of: dict[str, str]) -> str:
    scene, metric = of.get("scene", "all"), of.get("metric", "psnr")
    where = f" in {METRICS[metric].label}" + ("" if scene == "all" else f" on {scene}")
    return WORDS.get(quantity, quantity).format(**of, where=where)


def _number(text: str) -> Number:
    return float(text) if "." in text else int(text)


def stated(lines: Sequence[str]) -> ClaimFile:
    """Return one-line claims as a file; raises `InputError` for a line of another form."""
    claims = []
    for place, line in enumerate(lines, start=1):
        match = LINE.fullmatch(line.strip())
        if match is None:
            raise InputError(f"--claim {line!r}: is not of the form {FORM}")
        row = {name: match[name] for name in ("method", "against", "scene") if match[name]}
        unit = match["unit"]
        if unit.startswith("%"):
            if "against" not in row or "scene" in row:
                raise InputError(f"--claim {line!r}: a saving is of one method against another, over all scenes")
            row |= {"quantity": "saving", "axis": unit.removeprefix("%").strip(), "unit": "%"}
        else:
            metric = "psnr" if unit == "dB" else unit
            if metric not in METRICS:
                raise InputError(f"--claim {line!r}: {unit!r} is neither dB nor a metric ({', '.join(METRICS)})")
            row |= {"metric": metric}
        row |= {"printed": _number(match["printed"]), "bound": BOUNDS[match["bound"]], "id": f"claim-{place}"}
        claims.append(_statement(row, place, f"--claim {line!r}"))
    about = dict.fromkeys(claim.of["method"] for claim in claims)
    return ClaimFile(id=STATED, title="Stated claims", methods=tuple(about), claims=tuple(claims))


def claims_of(
    methods: Collection[str], scenes: Collection[str], files: Sequence[Path] = (), lines: Sequence[str] = ()
) -> list[ClaimFile]:
    """Return the claims that a run can show: the user's, and the files of this program about one of its methods. Raises
    `InputError` for a file about none of the methods, and for a line with a method or scene that does not run.
    """
    given = [read_claims(file) for file in files]
    for claims, name in zip(given, files, strict=True):
        if not set(claims.methods) & set(methods):
            raise InputError(f"{name}: {', '.join(claims.methods)} {NOT_RUN}; name it with --methods")
    if lines:
        given.insert(0, stated(lines))
        for claim, line in zip(given[0].claims, lines, strict=True):
            for role, known in (("method", methods), ("against", methods), ("scene", [*scenes, "all"])):
                if role in claim.of and claim.of[role] not in known:
                    raise InputError(f"--claim {line!r}: {claim.of[role]} {NOT_RUN}; name it with --{PLURAL[role]}")
    given += [file for file in known_claims() if set(file.methods) & set(methods)]
    names = [file.id for file in given]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two files of claims have the id {repeated[0]!r}")
    return given
