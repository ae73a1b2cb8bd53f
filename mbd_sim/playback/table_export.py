"""`mbd_sim export`: a recorded run as a flat table for pandas and others, a row for each state, units in the names."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.playback.run_table import ENERGY_NAMES, RunTable

KINDS = (".csv", ".parquet", ".npz")
_RATES = {"rad": "rad_s", "m": "m_s", "": ""}
_EFFORTS = {"rad": "Nm", "m": "N", "": ""}


def require_kind(path: Path, kinds: tuple[str, ...]) -> None:
    """Refuse a file of another kind.

    :raises MbdSimError: its name ends otherwise, or its folder is not there.
    """
    if path.suffix not in kinds:
        raise MbdSimError(f"{path}: can be written as {', '.join(kinds)}; name the file so")
    if not path.parent.is_dir():
        raise MbdSimError(f"{path}: there is no folder {path.parent}")


def columns(table: RunTable) -> dict[str, Array | np.ndarray]:
    """Columns (n,) by name and unit, such as `elbow.velocity_rad_s`; without those that hold nothing."""
    found: dict[str, Array | np.ndarray] = {"time_s": table.times}
    if table.own:
        found["step"] = table.steps
    for quantity, units, values in (
        ("position", {unit: unit for unit in _RATES}, table.position),
        ("velocity", _RATES, table.velocity),
        ("effort", _EFFORTS, table.effort),
    ):
        for index, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
            if not np.all(np.isnan(values[:, index])):
                found[f"{name}.{quantity}" + (f"_{units[unit]}" if units[unit] else "")] = values[:, index]
    if table.energies is not None:
        found |= {f"energy.{name}_J": table.energies[:, index] for index, name in enumerate(ENERGY_NAMES)}
    return found


def export(path: Path, table: RunTable) -> int:
    """Write the columns; returns how many. Parquet and NumPy files also hold what the recording says about the run.

    :raises MbdSimError: the file cannot be written, or its kind needs a package that is not installed.
    """
    require_kind(path, KINDS)
    found = columns(table)
    about = {**table.about, "recording": str(table.path), "events": json.dumps(table.events)}
    try:
        if path.suffix == ".npz":
            np.savez_compressed(path, about=json.dumps(about), **found)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            _csv(path, found)
        else:
            _parquet(path, found, about)
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {error}") from error
    return len(found)


def _csv(path: Path, found: Mapping[str, Array | np.ndarray]) -> None:
    """Numbers as short as they can be and still read back exactly."""
    lists = [column.tolist() for column in found.values()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(_quoted(name) for name in found) + "\n")
        for row in zip(*lists, strict=True):
            stream.write(",".join("" if value != value else repr(value) for value in row) + "\n")


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n') else name


def _parquet(path: Path, found: Mapping[str, Array | np.ndarray], about: Mapping[str, str]) -> None:
    try:
        import pyarrow as pa
        import pyarrow.parquet
    except ImportError as error:
        raise MbdSimError(
            "Parquet needs pyarrow. Install it with: pip install pyarrow; or write .csv or .npz"
        ) from error
    pyarrow.parquet.write_table(pa.table(dict(found)).replace_schema_metadata(dict(about)), str(path))
