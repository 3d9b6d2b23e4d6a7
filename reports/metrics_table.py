"""The other scores beside PSNR, and every comparison that was made, in full."""

from reports.grid import EMPTY, Column, Entry, Grid
from reports.load import Records
from reports.psnr_table import TOGETHER, difference_entry, losses, tone_of
from reports.selection import Selection
from reports.table import METRICS, Metric, average_of, cells_frame, shared_scenes, spread_of
from reports.wording import number


def metrics_grid(records: Records) -> Grid:
    """A row for each scene and method: means over the finished seeds."""
    frame = cells_frame(records)
    shown = [metric for metric in METRICS if frame[metric.name].notna().any()]
    columns = [Column("scene", numeric=False), Column("method", numeric=False)]
    for metric in shown:
        arrow = "↑" if metric.higher_is_better else "↓"
        columns.append(Column(f"{metric.label} {arrow}", small=metric.unit))
    rows, totals = [], []
    for scene in records.scenes:
        for place, method in enumerate(records.methods):
            cells = records.cells_of(scene, method)
            if not cells:
                continue
            lost = losses(cells)
            behind = Selection(scene, method)
            row = [Entry(scene if place == 0 else "", value=scene), Entry(method, lost, tone_of(cells), runs=behind)]
            for metric in shown:
                mean = spread_of(frame, scene, method, metric.name).mean
                row.append(score(mean, metric, scene, method))
            rows.append(row)
    for place, method in enumerate(records.methods if len(records.scenes) > 1 else []):
        row = [Entry("mean" if place == 0 else "", value="mean"), Entry(method)]
        for metric in shown:
            mean = average_of(frame, method, metric.name, shared_scenes(frame, metric.name)).mean
            row.append(score(mean, metric, "", method))
        totals.append(row)
    note = "; ".join(f"{metric.label}: {metric.meaning}" for metric in shown)
    return Grid("All scores", columns, rows, totals, f"Arrows point to the better side. {note}.")


def score(mean: float | None, metric: Metric, scene: str, method: str) -> Entry:
    """A mean with the runs that it is taken over."""
    if mean is None:
        return EMPTY
    return Entry(number(mean, metric.digits), value=mean, runs=Selection(scene, method, metric=metric.name))


def comparisons_grid(records: Records) -> Grid:
    """Every comparison of the run, with the smallest true difference that it would have found."""
    labels = {metric.name: metric.label for metric in METRICS}
    names = ("scene", "method − against", "metric", "at equal")
    columns = [Column(name, numeric=False) for name in names]
    columns += [Column("difference"), Column("smallest detectable"), Column("pairs")]
    rows = []
    for one in records.comparisons:
        digits = 2 if one.metric in ("psnr", "delta_e") else 4
        rows.append(
            [
                Entry("all scenes" if one.scene == "all" else one.scene),
                Entry(f"{one.method} − {one.against}"),
                Entry(labels.get(one.metric, one.metric)),
                Entry("steps" if one.budget == "steps" else "time"),
                difference_entry(one),
                Entry(number(one.smallest_detectable, digits), value=one.smallest_detectable),
                Entry(str(one.pairs)),
            ]
        )
    note = (
        "Smallest detectable: the true difference that a comparison with just this spread calls better or worse in "
        "80 % of repetitions. Looked at together are all scenes for PSNR, all other metrics over all scenes, and these "
        f"scene by scene; PSNR over all scenes stands alone. {TOGETHER}"
    )
    return Grid("Every comparison", columns, rows, note=note)
