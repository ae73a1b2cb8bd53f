"""Steps of explicit Runge–Kutta methods as C text, with the operations of `mbd_sim.compiler.steps.runge_kutta`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mbd_sim.exports.c_code.functions import c_function, literal
from mbd_sim.integrators.between_steps import BetweenSteps, DelayLine, Sampler
from mbd_sim.integrators.tableau import Tableau


@dataclass(frozen=True)
class StepParts:
    """What the steps of a system call besides `rates(t, y, in, slopes)`, which may have a last argument `&margin`.

    `ranges` are the indices of the components that have rates, as pairs of the first and the one after the last.
    """

    reports_margin: bool
    projects: bool
    samples: bool
    ranges: tuple[tuple[int, int], ...]


def moving_ranges(size: int, held: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """The ranges of the components that are not held."""
    found, first = [], 0
    for index in sorted(held):
        if index > first:
            found.append((first, index))
        first = index + 1
    return (*found, (first, size)) if first < size else tuple(found)


def step_function(method: Tableau, parts: StepParts) -> str:
    """`static void advance_METHOD(…)`, a step from known slopes, and `static void step_METHOD(…)`."""
    slopes = [f"k{stage}" for stage in range(1, method.stages + 1)]
    vectors = ", ".join(f"{name}[SIZE]" for name in [*slopes[1:], "trial"])
    margin, ignored = (", double margin", ", &ignored") if parts.reports_margin else ("", "")
    lines = [
        f"/* {method.name}, order {method.order}: from the time t to t + h, with the slopes k1 at t. */",
        f"static void advance_{method.name}(",
        f"    double t, double h, double *y, const double *in, const double *k1{margin})",
        "{",
        f"    double {vectors};",
        *(["    double ignored;"] if parts.reports_margin else []),
        "    int i;",
        "",
        *(["    memcpy(trial, y, sizeof trial);"] if parts.samples else []),
    ]
    for weights, c, into in zip(method.a[1:], method.c[1:], slopes[1:], strict=True):
        time = "t" if c == 0.0 else f"t + {literal(c)} * h"
        lines += _loops(parts, "trial", _stage(weights, slopes))
        if parts.reports_margin:
            lines += ["    if (margin < 0.0)", f"        project_in_place({time}, trial, in);"]
        lines.append(f"    rates({time}, trial, in, {into}{ignored});")
    lines += _loops(parts, "y", f"fma(h, {weighted_sum(method.b, slopes)}, y[i])")
    return "\n".join([*lines, "}", "", *_whole_step(method, parts)])


def _whole_step(method: Tableau, parts: StepParts) -> list[str]:
    first, value = (", &margin", ", margin") if parts.reports_margin else ("", "")
    return [
        f"static void step_{method.name}(",
        "    int64_t index, double t, double t_next, double h, double *y, const double *in, void *memory)",
        "{",
        "    double k1[SIZE];",
        *(["    double margin;"] if parts.reports_margin else []),
        "",
        "    (void)memory;",
        "    sample(index, t, y, in);" if parts.samples else "    (void)index;",
        f"    rates(t, y, in, k1{first});",
        f"    advance_{method.name}(t, h, y, in, k1{value});",
        "    project_in_place(t_next, y, in);" if parts.projects else "    (void)t_next;",
        "}",
    ]


def _loops(parts: StepParts, target: str, value: str) -> list[str]:
    loops = []
    for first, beyond in parts.ranges:
        end = "SIZE" if parts.ranges == ((first, beyond),) and first == 0 else str(beyond)
        loops += [f"    for (i = {first}; i < {end}; i++)", f"        {target}[i] = {value};"]
    return loops


def _stage(weights: Sequence[float], slopes: Sequence[str]) -> str:
    """The state of a stage: the last slope is added last, since it is computed last."""
    *early, (weight, last) = [(w, k) for w, k in zip(weights, slopes, strict=False) if w]
    start = "y[i]"
    if early:
        start = f"fma(h, {weighted_sum([w for w, _ in early], [k for _, k in early])}, y[i])"
    return f"fma(h * {literal(weight)}, {last}[i], {start})"


def weighted_sum(weights: Sequence[float], slopes: Sequence[str]) -> str:
    """Σ weight slope, from left to right."""
    (weight, name), *others = [(w, k) for w, k in zip(weights, slopes, strict=False) if w]
    value = f"{name}[i]" if weight == 1.0 else f"{literal(weight)} * {name}[i]"
    for weight, name in others:
        value = f"fma({literal(weight)}, {name}[i], {value})"
    return value


def sample_functions(between: BetweenSteps) -> str:
    """`static void sample(int64_t index, double t, double *y, const double *in)`: what changes before a step."""
    functions = [
        c_function(sampler.function, f"sampled_{number}", ("t", "y", "in"), ("out",), ("t",))
        for number, sampler in enumerate(between.samplers)
    ]
    size = max([1, *(len(sampler.components) for sampler in between.samplers)])
    lines = [
        "/* Delayed commands move on, and sampled controllers act. */",
        "static void sample(int64_t index, double t, double *y, const double *in)",
        "{",
        f"    double due, out[{size}];",
        "",
        "    (void)index;",
        "    (void)t;",
        "    (void)due;",
        "    (void)out;",
    ]
    for delay in between.delays:
        lines += _delay(delay)
    for number, sampler in enumerate(between.samplers):
        lines += _sampled(number, sampler)
    return "\n\n".join([*functions, "\n".join([*lines, "}"])])


def _delay(delay: DelayLine) -> list[str]:
    slot = f"y[index % {delay.length} + {delay.first}]"
    return [f"    due = {slot};", f"    {slot} = in[{delay.source}];", f"    y[{delay.into}] = due;"]


def _sampled(number: int, sampler: Sampler) -> list[str]:
    calls = [f"sampled_{number}(t, y, in, out);"]
    calls += [f"y[{component}] = out[{index}];" for index, component in enumerate(sampler.components)]
    if sampler.every == 1:
        return [f"    {call}" for call in calls]
    return [f"    if (index % {sampler.every} == 0) {{", *(f"        {call}" for call in calls), "    }"]
