"""A recorded run and a changed one in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mbd_sim.errors import MbdSimError
from mbd_sim.recording.what_if import Series, WhatIf

MOST = 6  # coordinates that are drawn: those that deviate most
RECORDED = {"color": "0.45", "linewidth": 2.2, "label": "recorded"}
CHANGED = {"color": "tab:red", "linewidth": 1.0, "label": "changed"}


def draw(path: Path, found: WhatIf, title: str, change: str) -> None:
    """Draw positions, velocities and energies of both runs over time; `change` names the changed one.

    :raises MbdSimError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    positions, velocities = found.coordinates["position"], found.coordinates["velocity"]
    order = sorted(range(len(positions)), key=lambda n: -positions[n].largest[0])[:MOST]
    chosen = sorted(order)
    figure = Figure(figsize=(11.0, 2.1 * (len(chosen) + 1) + 0.6), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left")
    panels = figure.subplots(len(chosen) + 1, 2, sharex=True, squeeze=False)
    for row, number in enumerate(chosen):
        _overlay(panels[row][0], positions[number], change)
        _overlay(panels[row][1], velocities[number], change)
    energies = {series.name: series for series in found.energies}
    _overlay(panels[-1][0], energies["total"]._replace(name="total energy, J"), change)
    _residuals(panels[-1][1], energies["residual"], change)
    for axes in panels[-1]:
        axes.set_xlabel("time since the beginning of the recording, s")
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize="small")
    try:
        figure.savefig(path, dpi=140)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _overlay(axes: object, series: Series, change: str) -> None:
    axes.plot(series.times, series.recorded, **RECORDED)  # type: ignore[attr-defined]
    axes.plot(series.times, series.changed, **(CHANGED | {"label": change}))  # type: ignore[attr-defined]
    _finish(axes, series.name)


def _residuals(axes: object, series: Series, change: str) -> None:
    """The errors of both integrations, which have no common value: on a logarithmic scale."""
    for values, style in ((series.recorded, RECORDED), (series.changed, CHANGED | {"label": change})):
        axes.semilogy(series.times, abs(values) + 1e-18, **style)  # type: ignore[attr-defined]
    _finish(axes, "|energy residual|, J")


def _finish(axes: object, name: str) -> None:
    axes.set_ylabel(name)  # type: ignore[attr-defined]
    axes.grid(alpha=0.3)  # type: ignore[attr-defined]


def largest(series: Sequence[Series]) -> list[tuple[str, float, float]]:
    """Name, largest deviation and time of it, the largest first."""
    return sorted(((one.name, *one.largest) for one in series), key=lambda row: -row[1])
