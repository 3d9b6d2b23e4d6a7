"""What the names in a table of results mean: roles of columns, metrics, scenes that everybody uses, and all else."""

import re
from collections.abc import Iterable, Sequence

from harness.records.metric_table import METRICS
from harness.verdicts.tables.numbers import ARROWS

SCENE = ("scene", "scene_name", "scenes", "object", "scan", "dataset", "data", "experiment", "experiment_name")
METHOD = ("method", "model", "algorithm", "approach", "method_name", "methods", "models", "name")
"""The names of a column of scenes or methods, the preferred one first."""
LOWER = {name for name, metric in METRICS.items() if not metric.higher_is_better}
LOWER |= {"rmse", "mse", "mae", "fid", "kid", "dists", "chamfer", "dssim", "mlpips", "error", "err", "loss"}
"""The metrics that are better when lower, also as part of a name, as in `lpips_vgg`."""
HIGHER = {name for name, metric in METRICS.items() if metric.higher_is_better}
HIGHER |= {"iou", "msssim", "mpsnr", "mssim", "accuracy", "f1"}
KNOWN = {*METRICS, *LOWER, *HIGHER, "ms-ssim"} - {"error", "err", "loss"}
INVERTED = re.compile(r"(?:1|one)\s*(?:[-−–]|[_ ]?minus[_ ]?)\s*|neg(?:ative)?[_ ]|inv(?:erse)?[_ ]")
"""The beginning of the name of a metric that is turned round, as in `1 - SSIM`."""
RUN = re.compile(
    r"(?:^|[\s_/-]+)\(?seed[\s_#=-]*(\d+)\)?$|\s*[(\[](?:seed|run|trial)[\s_#=-]*(\d+)[)\]]$", re.IGNORECASE
)
"""The seed at the end of a name."""
NUMBERED = re.compile(r"[\s_-]*[(\[]?(\d+)[)\]]?$")
"""The number at the end of a name."""
SEED = ("seed", "run", "trial", "random_seed", "rep", "repeat", "run_id")
ROLES = {"scene": SCENE, "method": METHOD, "metric": ("metric", "metrics", "measure"), "seed": SEED}
VALUE = ("value", "score", "result", "mean")
"""The name of a column of numbers of which another column, the file or the text around says what they are."""
ASIDE = {
    "year", "venue", "publication", "params", "param", "parameters", "fps", "time", "times", "memory", "mem", "vram",
    "size", "gaussians", "points", "primitives", "storage", "steps", "step", "iterations", "iters", "rank", "gpu",
    "speed", "hours", "minutes", "seconds", "views", "images", "epochs", "best", "hardware", "width", "height",
    "resolution", "downscale", "layers", "batch", "cost", "mb", "gb", "flops", "mflops", "gflops", "tflops", "macs",
    "gmacs", "latency", "throughput", "ratio", "cr", "bpp", "bitrate", "num", "number", "runtime", "speedup",
    "iter",
}  # fmt: skip
"""What a column is about that holds neither scenes nor scores."""
WITH_ASIDE = {
    "train", "training", "tr", "render", "rendering", "rend", "inference", "inf", "test", "model", "peak", "of",
    "total", "optimization", "optimisation", "opt", "encoding", "enc", "decoding", "dec", "compression", "comp",
    "per", "scene", "disk", "in", "on", "the", "input", "avg", "average", "mean", "min", "mins", "sec", "h", "s",
    "ms", "m", "k", "gs", "splats", "file", "ckpt", "run", "convergence",
}  # fmt: skip
"""The words that may stand next to them."""
UNITS = {"db", "s", "sec", "ms", "min", "mins", "h", "hr", "hrs", "mb", "gb", "kb", "m", "k", "%", "it/s"}
OF_TIME_OR_SIZE = {"sec", "ms", "min", "mins", "minutes", "hours", "hrs", "mb", "gb", "kb", "it/s"}
AVERAGE = {"avg", "average", "mean", "ø", "⌀", "平均", "durchschnitt", "mittelwert", "moyenne", "promedio"}
WITH_AVERAGE = {
    "of", "all", "scenes", "scene", "the", "over", "indoor", "outdoor", "total", "overall", "real", "synthetic", "db",
    *KNOWN,
}  # fmt: skip
"""The words that may stand next to them."""
WEAK_AVERAGE = {"all", "total", "overall", *AVERAGE}
"""The words in the names of what is a mean of the others if its values are."""
SPREAD = {"std", "sd", "stdev", "stddev", "stderr", "sem", "deviation", "variance"}
STATISTICS = {
    "median", "min", "max", "minimum", "maximum", "worst", "sum", "range", "std. dev.", "σ", "p-value", "p value",
    "var", "improv.", "macro", "aggregate", "summary",
}  # fmt: skip
"""The names of rows and columns of other statistics of results."""
DIFFERENCE = re.compile(r"[δ∆]|(?:delta|diff|difference|gain|improvement)(?:$|[\s:(]+(?:$|over|vs|to|of|from|in))")
QUALIFIERS = {*AVERAGE, "test", "eval", "score", "value", "vgg", "alex", "db", "per", "view", "scene", "image", ""}
"""The words next to the name of a metric that say nothing of a scene."""
SCENES = frozenset(
    word
    for words in (
        "chair drums ficus hotdog lego materials mic ship",
        "bicycle garden bonsai counter kitchen room stump flowers treehill",
        "fern flower fortress horns leaves orchids trex",
        "truck train barn caterpillar ignatius meetingroom courthouse auditorium ballroom courtroom museum palace",
        "temple family francis horse lighthouse m60 panther playground drjohnson playroom",
    )
    for word in words.split()
)
"""The scenes of public data sets."""
SCAN = re.compile(r"scan[ _]?\d+")
DATA_SETS = frozenset(
    word
    for words in (
        "blender nerfsynthetic syntheticnerf syntheticblender blendersynthetic mipnerf360 mip360 m360 nerf360",
        "tankstemples tanktemple tnt tt deepblending db llff nerfllff llffnerf forwardfacing nsvf syntheticnsvf",
        "nsvfsynthetic dtu replica scannet realestate10k re10k dl3dv shinyblender refnerf bungeenerf dnerf hypernerf",
    )
    for word in words.split()
)
"""The public data sets, as letters and digits."""


def bare(name: str) -> str:
    """Return a header in lower case, without arrows, and without what stands in brackets."""
    text = re.sub(r"[(\[][^()\[\]]*[)\]]", " ", name.lower())
    return " ".join(text.translate(dict.fromkeys(map(ord, f"{ARROWS}→"), " ")).split())


def column_name(name: str) -> str:
    """Return the name of a column in lower case, without arrows and units: `psnr` for `PSNR (dB) ↑`, `test_psnr`."""
    text = re.sub(r"\s*[(\[](?:db|s|↑|↓)[)\]]", "", name.strip(f" {ARROWS}").lower()).strip(f" {ARROWS}")
    is_mean = metric_of(text) and not beside_metric(text) and not {*words_of(text)} & {"vgg", "alex", *SPREAD}
    return metric_of(text) if is_mean and not INVERTED.match(text) else text


def arrow_of(name: str) -> str:
    """Return `↑` or `↓` if a header says which way its metric is better, else nothing."""
    text = name.lower()
    down = any(sign in text for sign in "↓⬇▼") or "lower is better" in text
    up = any(sign in text for sign in "↑⬆▲") or "higher is better" in text
    return "" if down == up else "↓" if down else "↑"


def words_of(name: str) -> list[str]:
    return [word for word in re.split(r"[^\w#%∆⌀-]+|_", name.lower()) for word in [word.strip("-")] if word]


def role_of(name: str) -> str:
    """Return `scene`, `method`, `metric` or `seed` for the name of a column of these, of two such names the first."""
    parts = re.split(r"[\\/|]| vs\.? ", name)
    if "→" in name and "↓" in name:  # an arrow that points at the rows
        parts = [part for part in parts if "↓" in part]
    for part in map(bare, parts):
        word = re.sub(r"[\s_](?:id|name|no\.?|number)$", "", part.strip())
        for role, names in ROLES.items():
            if word in names or part.strip() in names:
                return role
    return ""


def metric_of(name: str) -> str:
    """Return the known metric that a name holds, in lower case; empty if none or several."""
    low = name.lower()
    if re.search(r"\bd-?ssim|ssim[ _](?:error|err|loss)", low) or (INVERTED.match(low) and "ssim" in low):
        return "dssim"
    if INVERTED.match(low):
        return ""
    words = [re.sub(r"-(?:vgg|alex|squeeze|y|m|c)$", "", word) for word in re.findall(r"[a-z0-9_\-]+", low)]
    words += [part for word in words for part in word.split("_")]
    found = dict.fromkeys(word for word in words if word in KNOWN)
    if len(found) > 1:  # `depth_rmse` is one, and so is `ms-ssim`
        found = dict.fromkeys(word for word in found if not any(word != other and word in other for other in found))
    return next(iter(found)) if len(found) == 1 else ""


def metrics_named(text: str) -> list[str]:
    """Return all metrics that a text names, in its order."""
    parts = (metric_of(part) for part in re.split(r"[/|;,]|\band\b|\s{2,}", text))
    several = [metric for metric in parts if metric]
    return list(dict.fromkeys(several or [word for word in re.findall(r"[a-z0-9-]+", text.lower()) if word in KNOWN]))


def beside_metric(name: str) -> str:
    """Return what a name holds besides a metric: `bicycle` of `bicycle_psnr`; empty for qualifiers."""
    metric = metric_of(name)
    text = re.sub(r"\(db\)", "", name, flags=re.IGNORECASE)
    place = text.lower().find(metric)
    if place >= 0:
        text = f"{text[:place]} {text[place + len(metric) :]}"
    rest = text.strip(f" _/:.()[]-*{ARROWS}")
    return "" if {part.lower() for part in re.split(r"[\s_/:.()\[\]-]+", rest)} <= QUALIFIERS else rest


def seed_of(name: str) -> str | None:
    match = RUN.search(name)
    return match[1] or match[2] if match else None


def without_seed(name: str) -> str:
    return RUN.sub("", name).strip()


def metrics_of_seeds(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return metric and seed of each name that holds both: `psnr_seed7`; or else `psnr_0` and `psnr_1`, as the numbers
    of a metric begin with 0 or 1 and none is left out.
    """
    known = {name: (without_seed(name), seed) for name in names if metric_of(name) and (seed := seed_of(name))}
    numbered = {name: (name[: match.start()], match[1]) for name in names if (match := NUMBERED.search(name))}
    of_metric: dict[str, list[int]] = {}
    for metric, seed in numbered.values():
        of_metric.setdefault(metric, []).append(int(seed))
    return known or {
        name: (metric, seed)
        for name, (metric, seed) in numbered.items()
        if metric_of(metric) and not beside_metric(metric)
        if sorted(of_metric[metric]) in ([*range(len(of_metric[metric]))], [*range(1, len(of_metric[metric]) + 1)])
    }


def is_average(name: str) -> bool:
    """Return whether a name says only that it is a mean: `Avg.`, `Outdoor average`, `Mean PSNR`."""
    words = {*words_of(bare(name))}
    return bool(words & AVERAGE) and words <= AVERAGE | WITH_AVERAGE


def may_be_average(name: str) -> bool:
    return bool({*words_of(bare(name))} & WEAK_AVERAGE)


def is_data_set(name: str) -> bool:
    """Return whether a name is that of a public data set: `Tanks & Temples`, `Mip-NeRF 360 avg`."""
    words = (word for word in words_of(bare(name)) if word not in {*AVERAGE, "and", "the", "dataset"})
    return re.sub(r"[^a-z0-9]", "", "".join(words)) in DATA_SETS


def is_aside(name: str) -> bool:
    """Return whether a column of this name holds neither scenes nor scores: a year, time, size, spread, difference."""
    words = {*words_of(bare(name))}
    if metric_of(name):
        return bool(words & {*SPREAD, "minutes", "hours", "seconds", "drop"})
    in_brackets = {part.strip() for part in re.findall(r"[(\[]([^()\[\]]*)[)\]]", name.lower())}
    return (
        (bool(words & (ASIDE | SPREAD)) and words <= ASIDE | SPREAD | WITH_ASIDE)
        or bare(name).startswith(("#", "vs. ", "vs "))
        or bare(name) in STATISTICS
        or bool(DIFFERENCE.match(bare(name)))
        or bool(in_brackets & OF_TIME_OR_SIZE)
    )


def share_of_scenes(names: Iterable[str]) -> float:
    """Return the share of names that are scenes of public data sets."""
    low = [" ".join(words_of(name)) for name in names]
    known = [name.replace(" ", "") in SCENES or bool(SCAN.fullmatch(name)) for name in low]
    return sum(known) / len(known) if known else 0.0


def quantity_in(texts: Sequence[str]) -> tuple[str, str]:
    """Return the metric that the first of `texts` names that names one, else the first that names a time, a size or a
    spread, by which the numbers are no scores.
    """
    for text in texts:
        if is_aside(text) or re.search(r"\btime in (?:min|sec|hour)|\bstandard deviation\b", text.lower()):
            return "", text
        if metric := metric_of(text):
            return metric, ""
        is_own = not metrics_named(text) or INVERTED.match(text.lower())
        is_short = len(text.split()) <= 5 and is_own and not role_of(text)
        if arrow_of(text) and is_short and column_name(text):
            return column_name(text), ""
    return "", ""
