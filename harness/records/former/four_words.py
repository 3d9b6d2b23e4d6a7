"""Converts the former verdicts (better, worse, equivalent, inconclusive) to a sign and a size."""

from typing import Any

from harness.records.metric_table import METRICS, PRIMARY, SMALLEST_SAVING, metric_of
from harness.records.verdict import OPEN, Sign, Verdict, verdict_of

NO_INTERVAL = {
    "better": Verdict("above 0", "open"),
    "worse": Verdict("below 0", "open"),
    "equivalent": Verdict("open", "smaller than matters"),
    "inconclusive": OPEN,
}
"""Map word → its verdict without an interval, which only savings of time have (more is better)."""
ENDS = [[first, second] for first in (int, float) for second in (int, float)]
FAILS: dict[str, Sign] = {"better": "below 0", "worse": "above 0", "inconclusive": "open"}
"""Map word → the sign of the difference of two shares of failed runs."""


def in_two_words(data: object, margin: float = METRICS[PRIMARY].smallest_of_interest) -> Any:
    """Return plain data of a record in which each former verdict on a difference is `{"sign": …, "size": …}`.

    Both follow from the interval and the margin of its metric; an inconclusive verdict stays open, as it may have had
    too few seeds. Other verdicts, on claims or omissions, stay as they are.
    """
    if isinstance(data, list):
        return [in_two_words(value, margin) for value in data]
    if not isinstance(data, dict):
        return data
    if isinstance(data.get("metric"), str) and "margin" not in data:
        margin = metric_of(data["metric"]).smallest_of_interest
    elif "saving" in data:
        margin = SMALLEST_SAVING
    elif isinstance(data.get("margin"), int | float):
        margin = float(data["margin"])
    data = {name: in_two_words(value, margin) for name, value in data.items()}
    word = data.get("verdict")
    if not isinstance(word, str):
        return data
    if word in FAILS and "p_value" in data:
        data["verdict"] = FAILS[word]
    elif word in NO_INTERVAL and ("smallest_detectable" in data or "same_weights_largest" in data):
        data["verdict"] = _sign_and_size(word, data.get("simultaneous") or data.get("interval"), margin)
    return data


def _sign_and_size(word: str, interval: object, margin: float) -> dict[str, str] | str:
    """Return the verdict as plain data, or the word itself, which readers refuse, if `interval` is not an interval."""
    if interval is None or word == "inconclusive":
        verdict = NO_INTERVAL[word]
    elif isinstance(interval, list | tuple) and [type(end) for end in interval] in ENDS:
        verdict = verdict_of((interval[0], interval[1]), margin)
    else:
        return word
    return {"sign": verdict.sign, "size": verdict.size}
