"""Exports a recorded run as a flat table, for example for pandas: one row per state, with units in the column names."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.recordings.views.plots import require_suffix
from mbd_sim.recordings.views.table import ENERGY_NAMES, RunTable

SUFFIXES = (".csv", ".parquet", ".npz")
_POSITION_UNITS = {"rad": "rad", "m": "m", "": ""}
_VELOCITY_UNITS = {"rad": "rad_s", "m": "m_s", "": ""}
_EFFORT_UNITS = {"rad": "Nm", "m": "N", "": ""}
Columns = Mapping[str, Array | np.ndarray]


def columns(table: RunTable) -> dict[str, Array | np.ndarray]:
    """Return columns (n,) by name and unit, such as `elbow.velocity_rad_s`; empty columns are left out.

    Those of a sensor, such as `sensor.imu.specific_force_x_m_s2`, hold its last measurement that had arrived.
    """
    found: dict[str, Array | np.ndarray] = {"time_s": table.times}
    if table.is_run:
        found["step"] = table.steps
    for quantity, units, values in (
        ("position", _POSITION_UNITS, table.position),
        ("velocity", _VELOCITY_UNITS, table.velocity),
        ("effort", _EFFORT_UNITS, table.effort),
    ):
        for index, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
            if not np.all(np.isnan(values[:, index])):
                suffix = f"_{units[unit]}" if units[unit] else ""
                found[f"{name}.{quantity}{suffix}"] = values[:, index]
    if table.energies is not None:
        found |= {f"energy.{name}_J": table.energies[:, index] for index, name in enumerate(ENERGY_NAMES)}
    for sensor, measured in table.sensors.items():
        held = measured.held(len(table), table.resets)
        found |= {f"sensor.{sensor}.{name}": column for name, column in held.items()}
    return found | dict(table.requested)


def require_table(path: Path | None, *others: str) -> None:
    """Refuse a table that cannot be written, before anything is computed for it.

    :param others: further suffixes that are accepted.
    :raises InputError: it has another suffix, or its folder does not exist.
    :raises MissingPackageError: it is a Parquet file, and PyArrow is not installed.
    """
    if path is not None:
        require_suffix(path, (*others, *SUFFIXES))
        if path.suffix == ".parquet":
            require_packages("pyarrow", purpose="A Parquet file", otherwise="or choose a .csv or .npz file.")


def export(path: Path, table: RunTable) -> int:
    """Write the columns and return their number. Parquet and NumPy files also contain the description of the run.

    :raises MbdSimError: the file cannot be written, or its format needs a package that is not installed.
    """
    found = columns(table)
    about = {**table.about, "recording": str(table.path), "events": json.dumps(table.events)}
    write_columns(path, found, about)
    return len(found)


def write_columns(path: Path, found: Columns, about: Mapping[str, str]) -> None:
    """Write columns (n,) by name; Parquet and NumPy files also contain the description `about`.

    :raises MbdSimError: the file cannot be written, or its format needs a package that is not installed.
    """
    require_table(path)
    try:
        if path.suffix == ".npz":
            np.savez_compressed(path, about=json.dumps(about), **found)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            _write_csv(path, found)
        else:
            _write_parquet(path, found, about)
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {error}") from error


def _write_csv(path: Path, found: Columns) -> None:
    """Write each number with the fewest digits from which it is read back exactly."""
    lists = [column.tolist() for column in found.values()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(_quoted(name) for name in found) + "\n")
        for row in zip(*lists, strict=True):
            stream.write(",".join(map(_field, row)) + "\n")


def _field(value: object) -> str:
    return _quoted(value) if isinstance(value, str) else "" if value != value else repr(value)  # nan: empty


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n') else name


def _write_parquet(path: Path, found: Columns, about: Mapping[str, str]) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    pyarrow.parquet.write_table(pa.table(dict(found)).replace_schema_metadata(dict(about)), str(path))
