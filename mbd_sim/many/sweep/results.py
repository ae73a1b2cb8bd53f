"""The results of a sweep as Parquet or CSV files, and a plot of one of them over the varied values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import MbdSimError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.many.sweep.runs import Table

SUFFIXES = (".parquet", ".csv")


def write(path: Path, table: Table, metadata: dict[str, str]) -> None:
    """Write a table; the metadata is written only to Parquet.

    :raises MbdSimError: the file cannot be written.
    """
    require_packages("pyarrow", purpose="The table of a sweep")
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    arrow = pa.table(dict(table)).replace_schema_metadata(metadata)
    try:
        if path.suffix == ".csv":
            pyarrow.csv.write_csv(arrow, str(path))
        else:
            pyarrow.parquet.write_table(arrow, str(path))
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {error}") from error


def require_column(table_columns: Sequence[str], name: str) -> None:
    """Refuse a result that does not exist.

    :raises MbdSimError: with the nearest name.
    """
    if name not in table_columns:
        raise MbdSimError(f"there is no result '{name}'. {nearest(name, table_columns)}")


def draw(path: Path, table: Table, varied: Sequence[str], shown: str, title: str) -> None:
    """Plot the result `shown` into a file.

    Without varied values it is a histogram, with one a line, with two on a full grid a color map, and otherwise colored
    points over the first two.

    :raises MbdSimError: the result does not exist, or the file cannot be written.
    """
    require_column(list(table), shown)
    require_packages("matplotlib", purpose="A plot of a sweep")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title)
    if not varied:
        axes.hist(table[shown], bins=40)
        axes.set_xlabel(shown)
    elif len(varied) == 1:
        x, y = table[varied[0]], table[shown]
        order = np.argsort(x, kind="stable")
        repeated = len(np.unique(x)) < len(x)
        axes.plot(x[order], y[order], "." if repeated or len(x) > 2000 else ".-", markersize=3, linewidth=1)
        axes.set(xlabel=varied[0], ylabel=shown)
    else:
        x, y, z = (table[name] for name in (*varied[:2], shown))
        grid = _on_grid(x, y, z)
        if grid is not None:
            colored: Any = axes.pcolormesh(*grid, shading="nearest", cmap="viridis")
        else:
            colored = axes.scatter(x, y, c=z, s=6, cmap="viridis")
        axes.set(xlabel=varied[0], ylabel=varied[1])
        figure.colorbar(colored, ax=axes, label=shown)
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _on_grid(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array] | None:
    """The values z on the grid of x and y, or None unless each point of the grid has one value."""
    columns, rows = np.unique(x), np.unique(y)
    if len(columns) * len(rows) != len(z) or len(columns) < 2 or len(rows) < 2:
        return None
    found = np.full((len(rows), len(columns)), np.nan)
    found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = z
    return columns, rows, found
