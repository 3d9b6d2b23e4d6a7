"""Lines of made-up studies."""

from collections.abc import Callable

from harness.records.study import Series


def lines(
    panel: str, item: int, axes: tuple[str, str], x: list[float], y_of: Callable[..., float],
    names: dict[str, tuple[float, ...]], log: str = "xy",
) -> list[Series]:  # fmt: skip
    """A line for each name: `y_of` of x and what stands behind the name; `log` are the logarithmic axes."""
    return [
        Series(panel, item, name, *axes, x, [y_of(at, *more) for at in x], log_x="x" in log, log_y="y" in log)
        for name, more in names.items()
    ]
