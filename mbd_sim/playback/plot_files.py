"""Files that plots and tables are written to."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbd_sim.errors import InputError

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
PLOT_SUFFIXES = (*PICTURE_SUFFIXES, ".html")


def require_suffix(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse a file that cannot be written, before anything is read or computed for it.

    :raises InputError: it has another suffix, or its folder does not exist.
    """
    if path.suffix not in suffixes:
        raise InputError(f"{path}: this file format is not supported", f"Choose one of {', '.join(suffixes)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}", "Create it, or choose another file.")


def import_plotly() -> tuple[Any, Any]:
    """Return Plotly's modules `graph_objects` and `subplots`.

    :raises InputError: Plotly is not installed.
    """
    try:
        return importlib.import_module("plotly.graph_objects"), importlib.import_module("plotly.subplots")
    except ImportError as error:
        remedy = "Install it with: pip install plotly; or choose a .png, .svg or .pdf file."
        raise InputError("HTML needs Plotly", remedy) from error
