"""The overview: one row for each mechanism, from a summary that is small enough to be kept with the sources."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Any

from benchmarks.engines import OURS
from benchmarks.measure import Result
from benchmarks.saved import Measured
from benchmarks.table import microseconds, row, scientific, times

EULER, RK4, TAYLOR = "MuJoCo Euler", "MuJoCo RK4", "heyoka Taylor, own steps"
HEAD = ("", "**mbd_sim**, µs per step", "MuJoCo Euler, µs", "ratio", "**error at 3 s**", "Euler's error",
        "MuJoCo RK4 / our `rk4`", "heyoka, µs per ms", "ratio to ours, free running")  # fmt: skip
LEGEND = (
    "Default method and steps of 1 ms, one call each; ratios are medians [quartiles] of times taken in turn: above 1, "
    "`mbd_sim` is faster. Errors are relative. *Free running* is many steps in one call, by the default method or by "
    "`taylor`, whichever takes less time."
)
DIGITS = 4  # of the numbers in a summary


def summary(measured: Sequence[Measured]) -> dict[str, Any]:
    """The numbers of the overview and of README.md: times in µs, ratios as [median, lower and upper quartile]."""
    latest = measured[-1]
    return {
        "measured": latest.measured,
        "load": max(found.load for found in measured),
        "rounds": min(found.rounds for found in measured),
        "sample": min(found.sample for found in measured),
        "versions": latest.versions,
        "mechanisms": {found.mechanism: _numbers(found) for found in measured},
    }


def _numbers(found: Measured) -> dict[str, Any]:
    default, rk4 = found.result(found.default), found.result(f"{OURS} rk4")
    series = found.result(f"{OURS} taylor")
    free = min((one for one in (default, series) if one and one.many), key=lambda one: one.many, default=None)
    euler, other, taylor = (found.result(label) for label in (EULER, RK4, TAYLOR))
    return {
        "method": found.default.removeprefix(f"{OURS} "),
        "step": _rounded(default and default.each),
        "commanded": _rounded(default and default.commanded),
        "many": _rounded(default and default.many),
        "error": _rounded(default and default.error),
        "euler": _rounded(euler and euler.each),
        "euler_error": _rounded(euler and euler.error),
        "euler_ratio": _ratio(euler, default, "each"),
        "rk4_ratio": _ratio(other, rk4, "each"),
        "taylor": _rounded(taylor and taylor.many),
        "free": _rounded(free and free.many),
        "taylor_ratio": _ratio(taylor, free, "many"),
    }


def _rounded(value: float | None) -> float | None:
    """To `DIGITS` digits; None also where a simulator diverged."""
    return float(f"{value:.{DIGITS}g}") if value is not None and math.isfinite(value) else None


def _ratio(other: Result | None, ours: Result | None, kind: str) -> list[float] | None:
    if other is None or ours is None or kind not in other.samples or kind not in ours.samples:
        return None
    ratios = sorted(a / b for a, b in zip(other.samples[kind], ours.samples[kind], strict=True))
    low, median, high = statistics.quantiles(ratios, n=4, method="inclusive") if len(ratios) > 1 else ratios * 3
    return [float(f"{value:.{DIGITS}g}") for value in (median, low, high)]


def overview(numbers: dict[str, Any]) -> str:
    """The table of a summary, with its legend."""
    lines = [row(HEAD), row(["---", *["--:"] * (len(HEAD) - 1)])]
    for name, found in numbers["mechanisms"].items():
        lines.append(row([
            name, microseconds(found["step"]), microseconds(found["euler"]), spread(found["euler_ratio"]),
            scientific(found["error"]), scientific(found["euler_error"]), spread(found["rk4_ratio"]),
            microseconds(found["taylor"]), spread(found["taylor_ratio"]),
        ]))  # fmt: skip
    when = (
        f"Measured on {numbers['measured']} with a load of up to {numbers['load']:.1f}: {numbers['rounds']} samples of "
        f"{numbers['sample']:g} s of simulated time each."
    )
    return "\n".join([*lines, "", f"{LEGEND} {when}"])


def spread(ratio: Sequence[float] | None) -> str:
    """A median with its quartiles."""
    if ratio is None:
        return "–"
    median, low, high = (times(value) for value in ratio)
    return f"**{median}** [{low}–{high}]"


def readme_speed(numbers: dict[str, Any]) -> str:
    """The sentence on speed in README.md."""
    rows = numbers["mechanisms"]
    double = rows["2 rods"]
    ratios = [found["euler_ratio"][0] for found in rows.values() if found["euler_ratio"]]
    errors = [found["error"] for found in rows.values() if found["error"] is not None]
    others = [found["euler_error"] for found in rows.values() if found["euler_error"] is not None]
    middle = times(statistics.median(ratios))
    return (
        f"A step of a double pendulum takes {double['step']:.2g} µs, or {double['commanded']:.2g} µs with a new "
        f"command before each. On {len(rows)} mechanisms from one rod to a humanoid, MuJoCo's Euler step takes "
        f"{times(min(ratios))} to {times(max(ratios))} times as long (median {middle}), with errors after 3 s of "
        f"{scientific(min(others))} to {scientific(max(others))} where ours are at most {scientific(max(errors))}"
    )
