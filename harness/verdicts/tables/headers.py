"""What the names in a table of results mean: roles of columns, metrics, scenes that everybody uses, and all else."""

import re
from collections.abc import Iterable, Sequence

from harness.records.metric_table import METRICS
from harness.verdicts.tables.numbers import ARROWS

SCENE = ("scene", "scene_name", "scenes", "object", "scan", "dataset", "data", "experiment", "experiment_name")
METHOD = ("method", "model", "algorithm", "approach", "method_name", "methods", "models", "name")
"""The names of a column of scenes or methods, the preferred one first."""
LOWER = {name for name, metric in METRICS.items() if not metric.higher_is_better}
LOWER |= {"rmse", "mse", "mae", "fid", "kid", "dists", "chamfer", "dssim", "error", "err", "loss"}
"""The metrics that are better when lower, also as part of a name, as in `lpips_vgg`."""
HIGHER = {"psnr", "ssim", "iou", "msssim", "accuracy", "f1"}
KNOWN = {*METRICS, *LOWER, *HIGHER, "ms-ssim"} - {"error", "err", "loss"}
MEASURE = ("metric", "measure")
SEED = ("seed", "run", "trial", "random_seed")
VALUE = ("value", "score", "result", "mean")
"""The name of a column of numbers of which another column, the file or the text around says what they are."""
ASIDE = {
    "year", "venue", "publication", "params", "param", "parameters", "fps", "time", "memory", "mem", "vram", "size",
    "gaussians", "points", "primitives", "storage", "steps", "iterations", "iters", "rank", "gpu", "speed", "hours",
    "minutes", "views", "images", "epochs", "best", "hardware", "seed", "its",
}  # fmt: skip
"""The words of a column that holds neither scenes nor scores."""
UNITS = {"db", "s", "sec", "ms", "min", "mins", "h", "hr", "hrs", "mb", "gb", "kb", "m", "k", "%", "it/s"}
OF_TIME_OR_SIZE = UNITS - {"db", "%"}
AVERAGE = {"avg", "average", "mean", "ø", "⌀"}
WEAK_AVERAGE = {"all", "total", "overall"}
"""The names that hold means of the others if their values do."""
SPREAD = {"std", "sd", "stdev", "stddev", "stderr", "sem"}
DIFFERENCE = ("δ", "∆", "delta", "diff", "gain", "improvement")
QUALIFIERS = {*AVERAGE, *["test", "eval", "score", "value", "vgg", "alex", "db", "per", "view", "scene", "image"], ""}
"""The words next to the name of a metric that say nothing of a scene."""
SCENES = frozenset(
    word
    for words in (
        "chair drums ficus hotdog lego materials mic ship",
        "bicycle garden bonsai counter kitchen room stump flowers treehill",
        "fern flower fortress horns leaves orchids trex",
        "truck barn caterpillar ignatius meetingroom courthouse auditorium ballroom courtroom museum palace temple",
        "family francis horse lighthouse m60 panther playground drjohnson playroom",
    )
    for word in words.split()
)
"""The scenes of public data sets; `train` is left out, as it names a split as well."""
SCAN = re.compile(r"scan[ _]?\d+")


def bare(name: str) -> str:
    """Return a header in lower case, without arrows, and without what stands in brackets."""
    text = re.sub(r"[(\[][^()\[\]]*[)\]]", " ", name.lower())
    return " ".join(text.translate(dict.fromkeys(map(ord, ARROWS), " ")).split())


def column_name(name: str) -> str:
    """Return the name of a column in lower case, without arrows and units; `psnr` for `PSNR (dB) ↑` and `test_psnr`."""
    text = re.sub(r"\s*[(\[](?:db|s|↑|↓)[)\]]", "", name.strip(f" {ARROWS}").lower()).strip(f" {ARROWS}")
    is_mean = metric_of(text) and not beside_metric(text) and not {*words_of(text)} & {"vgg", "alex", *SPREAD}
    return metric_of(text) if is_mean else text


def is_lower(name: str) -> bool:
    """Return whether an arrow says that a metric is better when lower."""
    return any(sign in name for sign in "↓⬇▼")


def words_of(name: str) -> list[str]:
    return [word for word in re.split(r"[^a-z0-9øδ∆⌀#%-]+", name.lower()) for word in [word.strip("-")] if word]


def role_of(name: str) -> str:
    """Return `scene`, `method`, `metric` or `seed` for the name of a column of these, of two such names the first."""
    known = {"scene": {*SCENE}, "method": {*METHOD}}
    known |= {"metric": {*MEASURE, "metrics"}, "seed": {*SEED}}
    for part in re.split(r"[\\/|]| vs\.? ", bare(name)):
        for role, names in known.items():
            if part.strip() in names:
                return role
    return ""


def metric_of(name: str) -> str:
    """Return the known metric that a name holds, in lower case; empty if none or several."""
    if re.search(r"\b1\s*[-−–]\s*ssim|\bd-?ssim|ssim[ _]?(?:error|err|loss)", name.lower()):
        return "dssim"
    words = re.findall(r"[a-z0-9_\-]+", name.lower())
    words += [part for word in words for part in word.split("_")]
    found = dict.fromkeys(word for word in words if word in KNOWN)
    if len(found) > 1:  # `depth_rmse` is one, and so is `ms-ssim`
        found = dict.fromkeys(word for word in found if not any(word != other and word in other for other in found))
    return next(iter(found)) if len(found) == 1 else ""


def metrics_named(text: str) -> list[str]:
    """Return all metrics that a text names, in its order."""
    return list(dict.fromkeys(word for word in re.findall(r"[a-z0-9]+", text.lower()) if word in KNOWN))


def beside_metric(name: str) -> str:
    """Return what a name holds besides a metric: `bicycle` of `bicycle_psnr`; empty for qualifiers."""
    metric = metric_of(name)
    parts = [part for part in re.split(r"[\s_/:.()\[\]-]+", name) if part.lower().strip(ARROWS) not in QUALIFIERS]
    return " ".join(part for part in parts if part.lower().strip(ARROWS) not in (metric, *metric.split("_")))


def seed_of(name: str) -> str | None:
    match = re.search(r"(?:^|[\s_/-])(?:seed|run|trial)[\s_#-]*(\d+)$", name.lower())
    return match[1] if match else None


def is_average(name: str) -> bool:
    return bool({*words_of(bare(name))} & AVERAGE) or bare(name) in ("ø", "⌀")


def is_aside(name: str) -> bool:
    """Return whether a column of this name holds neither scenes nor scores: a year, time, size, spread, difference."""
    low = bare(name)
    if metric_of(name):
        return bool({*words_of(low)} & SPREAD)
    in_brackets = re.findall(r"[(\[]([^()\[\]]*)[)\]]", name.lower())
    return (
        bool({*words_of(low)} & (ASIDE | SPREAD))
        or low.startswith(("#", *DIFFERENCE))
        or any(part.strip() in OF_TIME_OR_SIZE for part in in_brackets)
    )


def share_of_scenes(names: Iterable[str]) -> float:
    """Return the share of names that are scenes of public data sets."""
    low = [" ".join(words_of(name)) for name in names]
    known = [name.replace(" ", "") in SCENES or bool(SCAN.fullmatch(name)) for name in low]
    return sum(known) / len(known) if known else 0.0


def quantity_in(texts: Sequence[str]) -> tuple[str, str]:
    """Return the metric that the first of `texts` names that names one, else the first that names a time or a size, by
    which the numbers are no scores.
    """
    for text in texts:
        if metric := metric_of(text):
            return metric, ""
        if len(text.split()) <= 8 and not metrics_named(text) and is_aside(text):
            return "", text
    return "", ""
