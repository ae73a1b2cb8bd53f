"""Files that plots and tables are written to."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbd_sim.errors import InputError
from mbd_sim.packages import require_packages

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


def require_plot_packages(path: Path) -> None:
    """Refuse a plot whose packages are missing, before anything is computed for it.

    :raises MissingPackageError: Matplotlib, or Plotly for a page, is not installed.
    """
    if path.suffix == ".html":
        require_packages("plotly", purpose="An HTML page of plots", otherwise="or choose a .png, .svg or .pdf file.")
    else:
        require_packages("matplotlib", purpose="A picture of plots", otherwise="or choose an .html file.")


def import_plotly() -> tuple[Any, Any]:
    """Return Plotly's modules `graph_objects` and `subplots`.

    :raises MissingPackageError: Plotly is not installed.
    """
    require_plot_packages(Path("page.html"))
    return importlib.import_module("plotly.graph_objects"), importlib.import_module("plotly.subplots")
