"""The options of commands that plot: for what the picture is, and on which ground."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from mbd_sim.base.errors import InputError
from mbd_sim.mechanism.values.names import split_names
from mbd_sim.recordings.views.panels import PlotStyle

RUN_PLOTS = "energies", "joints", "residual", "reactions", "sensors", "phase"
STYLES, THEMES = ("screen", "slide", "paper"), ("light", "dark")


def add_plot_style(parser: argparse._ActionsContainer) -> None:
    """Declare `--style` and `--theme`."""
    parser.add_argument(
        "--style",
        choices=STYLES,
        help="width and fonts of the plot: for a screen, a slide (10 in wide) or a column of a paper (3.5 in, without "
        "titles, with dashes) (default screen)",
    )
    parser.add_argument("--theme", choices=THEMES, help="ground of the plot (default light)")


def add_show(parser: argparse._ActionsContainer, plots: Sequence[str] = RUN_PLOTS) -> None:
    """Declare `--show`."""
    parser.add_argument(
        "--show",
        metavar="PLOTS",
        default="",
        help=f"what to plot: a comma-separated list of {', '.join(plots)} (default: all with data)",
    )


def add_coordinates(parser: argparse._ActionsContainer) -> None:
    """Declare `--coordinates` and `--deg`."""
    parser.add_argument(
        "--coordinates",
        metavar="NAMES",
        default="",
        help="coordinates to plot, separated by commas, or patterns such as 'leg_*' (default: all)",
    )
    parser.add_argument("--deg", action="store_true", help="plot angles in degrees (default: rad)")


def plotted_coordinates(options: argparse.Namespace, path: Path | None) -> list[str]:
    """The names and patterns that `--coordinates` lists.

    :raises InputError: it or `--deg` is given without a plot.
    """
    if path is None and (options.coordinates or options.deg):
        raise InputError("--coordinates, --deg: nothing is plotted", "Give --plot too.")
    return split_names(options.coordinates)


def shown_plots(options: argparse.Namespace, path: Path | None) -> list[str]:
    """The names that `--show` lists.

    :raises InputError: names are given without a plot.
    """
    names = split_names(options.show)
    if names and path is None:
        raise InputError("--show: nothing is plotted", "Give --plot too.")
    return names


def require_styled(options: argparse.Namespace, path: Path | None) -> None:
    """Refuse a style without a plot.

    :raises InputError: `path` is None, and a style is given.
    """
    given = [f"--{name}" for name in ("style", "theme") if getattr(options, name)]
    if path is None and given:
        raise InputError(f"{', '.join(given)}: nothing is plotted", "Give --plot too.")


def chosen_style(options: argparse.Namespace, path: Path | None) -> PlotStyle:
    """The style of the plot that goes to `path`.

    :raises InputError: a style is given without a plot, or does not fit the file.
    """
    from mbd_sim.recordings.views.panels import plot_style

    require_styled(options, path)
    return plot_style(path or Path(), options.style or "screen", options.theme or "light")
