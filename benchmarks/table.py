"""The results as Markdown tables."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence

from benchmarks.engines import OURS
from benchmarks.measure import Result

HEAD = ("", "µs per step, `step(1)`", "µs per step, many per call", "× rk4", "× default", "error at 3 s",
        "energy drift", "loop open, m", "set-up, s", "again, s", "memory, MB")  # fmt: skip


def markdown(results: Sequence[Result], default: str) -> str:
    """A table of the simulators on one mechanism, with their ratios to ours with `rk4` and to `default`, a label.

    Simulators that cannot be driven step by step are compared with many steps per call.
    """
    times = {result.label: result for result in results}
    lines = [row(HEAD), row(["---", *["--:"] * (len(HEAD) - 1)])]
    for result in results:
        ratios = [ratio(result, times.get(label)) for label in (f"{OURS} rk4", default)]
        name = f"**{result.label}**" if result.label.startswith(OURS) else result.label
        name += ", default" if result.label == default else ""
        lines.append(row([
            name, microseconds(result.each), microseconds(result.many), *ratios, scientific(result.error),
            drift(result), scientific(result.violation), seconds(result.setup), seconds(result.again),
            "–" if result.memory is None else f"{result.memory:.0f}",
        ]))  # fmt: skip
    shown = dict.fromkeys(HEAD) if any(result.violation is not None for result in results) else without("loop open, m")
    kept = [index for index, name in enumerate(HEAD) if name in shown]
    table = ["|".join(["", *(line.strip("|").split("|")[index] for index in kept), ""]) for line in lines]
    notes = [f"{result.label}: {result.note}." for result in results if result.note]
    return "\n".join([*table, *(["", *notes] if notes else [])])


def costs(measured: Mapping[str, Sequence[Result]]) -> str:
    """µs per step of all simulators on all mechanisms; in parentheses for many steps per call."""
    by_label: dict[str, dict[str, Result]] = {}
    for name, results in measured.items():
        for result in results:
            by_label.setdefault(result.label, {})[name] = result
    lines = [row(["µs per step", *measured]), row(["---", *["--:"] * len(measured)])]
    for label, found in by_label.items():
        cells = [one_time(found.get(name)) for name in measured]
        lines.append(row([f"**{label}**" if label.startswith(OURS) else label, *cells]))
    return "\n".join(lines)


def one_time(result: Result | None) -> str:
    """The time by single steps if there is one, else by many per call, in parentheses."""
    if result is None or result.many is None:
        return "–"
    return microseconds(result.each) if result.each is not None else f"({microseconds(result.many)})"


def without(name: str) -> dict[str, None]:
    """All column heads except one."""
    return dict.fromkeys(head for head in HEAD if head != name)


def row(cells: Sequence[str]) -> str:
    """A line of a table."""
    return f"| {' | '.join(cells)} |"


def ratio(result: Result, ours: Result | None) -> str:
    """The ratio of times; in parentheses if only many steps per call can be compared."""
    if ours is None or result.many is None or ours.many is None:
        return "–"
    if result.each is None:
        return f"({times(compared(result, ours, 'many'))})"
    return times(compared(result, ours, "each"))


def compared(result: Result, ours: Result, kind: str) -> float:
    """The median of the ratios of samples taken in the same round."""
    pairs = zip(result.samples[kind], ours.samples[kind], strict=True)
    return statistics.median(other / own for other, own in pairs)


def times(value: float) -> str:
    """A ratio, with two or three digits."""
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def microseconds(value: float | None) -> str:
    """Three digits."""
    return "–" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def seconds(value: float | None) -> str:
    """Down to milliseconds."""
    return "–" if value is None else f"{value:.3f}" if value < 1 else f"{value:.1f}"


def scientific(value: float | None) -> str:
    """One digit and the power of ten."""
    if value is None:
        return "–"
    return f"{value:.0e}" if math.isfinite(value) else "∞"


def drift(result: Result) -> str:
    """Signed, in percent if large, with the duration if it is not the usual one."""
    if result.drift is None:
        return "–"
    if not math.isfinite(result.drift):
        return "∞"
    value = f"{100 * result.drift:+.0f} %" if abs(result.drift) > 0.01 else f"{result.drift:+.0e}"
    return value if result.monitored == 100.0 else f"{value} ({result.monitored:g} s)"
