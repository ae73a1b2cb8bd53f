"""Tables of results as Parquet or CSV files."""

from __future__ import annotations

from pathlib import Path

from mbd_sim.errors import MbdSimError
from mbd_sim.packages import require_packages
from mbd_sim.sweep.sweep_runs import Table

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
