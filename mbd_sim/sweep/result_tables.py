"""Tables of results as files: Parquet, or text with commas."""

from __future__ import annotations

from pathlib import Path

from mbd_sim.errors import MbdSimError
from mbd_sim.sweep.sweep_runs import Table

KINDS = (".parquet", ".csv")


def require_kind(path: Path) -> None:
    """Refuse a file of another kind.

    :raises MbdSimError: its name ends otherwise, or its folder is not there.
    """
    if path.suffix not in KINDS:
        raise MbdSimError(f"{path}: tables are written as {' or '.join(KINDS)}; name the file so")
    if not path.parent.is_dir():
        raise MbdSimError(f"{path}: there is no folder {path.parent}")


def write(path: Path, table: Table, metadata: dict[str, str]) -> None:
    """Write a table; Parquet keeps the metadata."""
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
