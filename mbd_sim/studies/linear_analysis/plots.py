"""Frequency responses, root loci and stability maps as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.analysis.linear.state_space import StateSpace
from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.studies.linear_analysis.loci import EigenvalueLocus

NEUTRAL = 1e-6  # growth, relative to the largest, at which the limit of stability is drawn: neutral states are within
_LEAST = 1e-300  # of a magnitude, for its logarithm
_LEGEND = 12  # entries


def draw_bode(path: str | Path, system: StateSpace, frequencies: Sequence[float] | Array, title: str = "") -> None:
    """Draw magnitude and phase of all pairs of inputs and outputs over the frequencies in Hz, as .png, .svg or .pdf.

    :raises MissingPackageError: Matplotlib is not installed.
    :raises MbdSimError: the file cannot be written.
    """
    figure = _figure((7.0, 5.6))
    magnitude, phase = figure.subplots(2, sharex=True)
    found, x = system.response(frequencies), np.asarray(frequencies, dtype=float)
    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            values = found[:, row, column]
            if not np.any(np.abs(values) > 0.0):
                continue
            unit = f"{_in(system.output_units[row])} / {_in(system.input_units[column])}"
            magnitude.loglog(
                x, np.maximum(np.abs(values), _LEAST), linewidth=1.2, label=f"{output} / {given} in {unit}"
            )
            phase.semilogx(x, np.degrees(np.unwrap(np.angle(values))), linewidth=1.2)
    magnitude.set(ylabel="magnitude", title=title)
    phase.set(xlabel="frequency in Hz", ylabel="phase in °")
    phase.yaxis.get_major_locator().set_params(steps=[1, 1.5, 3, 4.5, 9, 10])
    for axes in (magnitude, phase):
        axes.grid(which="both", linewidth=0.3)
    if 0 < len(magnitude.lines) <= _LEGEND:
        magnitude.legend(fontsize=7)
    _save(figure, path)


def draw_locus(path: str | Path, locus: EigenvalueLocus, title: str = "") -> None:
    """Draw the eigenvalues over one value as a root locus, or over two values as a map of the largest growth rate.

    :raises InputError: there are no values, or more than two.
    :raises MissingPackageError: Matplotlib is not installed.
    :raises MbdSimError: the file cannot be written.
    """
    if len(locus.names) not in (1, 2):
        raise InputError(f"a picture of {len(locus.names)} varied values is not drawn", "Vary one or two.")
    figure = _figure((7.0, 4.8))
    axes = figure.add_subplot()
    axes.set_title(title)
    if len(locus.names) == 1:
        _root_locus(figure, axes, locus)
    else:
        _stability_map(figure, axes, locus)
    _save(figure, path)


def _root_locus(figure: Any, axes: Any, locus: EigenvalueLocus) -> None:
    (values,), roots = locus.values, locus.eigenvalues
    colors = np.repeat(values, roots.shape[1])
    drawn = axes.scatter(roots.real.ravel(), roots.imag.ravel(), c=colors, s=7, cmap="viridis", zorder=3)
    first, last = roots[0], roots[-1]
    axes.plot(first.real, first.imag, "x", color="black", markersize=6, label=f"{values[0]:.4g}")
    axes.plot(last.real, last.imag, "o", color="black", markersize=6, fillstyle="none", label=f"{values[-1]:.4g}")
    axes.axvline(0.0, color="black", linewidth=0.6)
    axes.grid(linewidth=0.3)
    axes.set(xlabel="real part in 1/s", ylabel="imaginary part in rad/s")
    axes.legend(title=locus.names[0], fontsize=8, title_fontsize=8)
    figure.colorbar(drawn, ax=axes, label=locus.names[0])


def _stability_map(figure: Any, axes: Any, locus: EigenvalueLocus) -> None:
    (x, y), growth = locus.values, locus.growth.T
    largest = float(np.nanmax(np.abs(growth), initial=0.0)) or 1.0
    drawn = axes.pcolormesh(x, y, growth, shading="nearest", cmap="RdBu_r", vmin=-largest, vmax=largest)
    if min(growth.shape) > 1 and np.nanmin(growth) <= 0.0 < np.nanmax(growth):
        axes.contour(x, y, growth, levels=[NEUTRAL * largest], colors="black", linewidths=1.0)
    axes.set(xlabel=locus.names[0], ylabel=locus.names[1])
    figure.colorbar(drawn, ax=axes, label="largest real part in 1/s")


def _in(unit: str) -> str:
    return f"({unit})" if "/" in unit or " " in unit else unit or "1"


def _figure(size: tuple[float, float]) -> Any:
    require_packages("matplotlib", purpose="A plot")
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


def _save(figure: Any, path: str | Path) -> None:
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error
