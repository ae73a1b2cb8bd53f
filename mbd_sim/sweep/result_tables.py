"""Tables of results as Parquet or CSV files."""

from __future__ import annotations

from pathlib import Path

from mbd_sim.errors import MbdSimError
from mbd_sim.packages import require_packages
from mbd_sim.sweep.sweep_runs import Table

SUFFIXES = (".parquet", ".csv")


def require_suffix(path: Path) -> None:
    """Refuse a file that is not one of `SUFFIXES`.

    :raises MbdSimError: the suffix is a different one, or the folder does not exist.
    """
    if path.suffix not in SUFFIXES:
        raise MbdSimError(f"{path}: the name of a table must end in {' or '.join(SUFFIXES)}.")
    if not path.parent.is_dir():
        raise MbdSimError(f"{path}: the folder {path.parent} does not exist.")


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
