"""Arguments and output that several subcommands share, those about plots among them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbd_sim.base.errors import InputError, listed
from mbd_sim.files.text.units import parse_value, split_unit
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import split_names
from mbd_sim.pictures.shapes.meshes import undrawn_meshes

if TYPE_CHECKING:  # few subcommands read recordings, whose modules take half of the time of `check`
    from mbd_sim.recordings.views.panels import PlotStyle

ROUND_OFF = 1e-13  # of a number that was computed over many steps, relative to the numbers that cancel in it
DURATION = 10.0  # s that are simulated where no time is given

MCAP_OR_BAG = "an .mcap file or a rosbag2 folder"
ANY_RECORDING = "an .mcap or .db3 file, or a rosbag2 folder"


def add_mechanism(parser: argparse.ArgumentParser) -> None:
    """Declare the argument `mechanism`."""
    parser.add_argument(
        "mechanism",
        metavar="FILE",
        help="a mechanism file, a URDF, MJCF, SDF or xacro file, or the name of a shipped mechanism; the arguments of "
        "a xacro file follow it: FILE NAME:=VALUE …",
        nargs="+",
        action=_WithArguments,
    )


class _WithArguments(argparse.Action):
    """Joins a file and its arguments `name:=value` to the text that `load_mechanism` takes."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        file, *arguments = values
        if strange := [word for word in arguments if ":=" not in word]:
            parser.error(f"unrecognized arguments: {' '.join(strange)}")
        setattr(namespace, self.dest, " ".join([file, *arguments]))


def add_recordings(parser: argparse.ArgumentParser, kinds: str) -> None:
    """Declare the argument `recordings`, one or more; `kinds` says which ones are accepted."""
    parser.add_argument("recordings", metavar="RUN", type=Path, nargs="+", help=f"{kinds}; one or more")


def add_repeatable(parser: argparse._ActionsContainer, name: str, metavar: str, help_text: str, **further: Any) -> None:
    """Declare an option that may be given several times, whose values are a list."""
    parser.add_argument(name, action="append", default=[], metavar=metavar, help=help_text, **further)


def add_duration(parser: argparse.ArgumentParser) -> None:
    """Declare `--time`."""
    parser.add_argument(
        "--time",
        type=positive_in("s"),
        default=DURATION,
        metavar="S",
        help=f"seconds to simulate (default {DURATION:g}), or a value with a unit, such as 200ms",
    )


def add_method_and_step(parser: argparse._ActionsContainer, default: str) -> None:
    """Declare `--method` and `--step`; `default` says where they come from when they are not given."""
    parser.add_argument("--method", help=f"integration method (default: {default})")
    parser.add_argument(
        "--step", type=positive_in("s"), metavar="S", help=f"time step in seconds (default: {default}), or such as 2ms"
    )


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Declare `--quiet`."""
    parser.add_argument("--quiet", action="store_true", help="show no progress bar")


def positive_number(text: str) -> float:
    """An argument's positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def positive_in(si_unit: str) -> Callable[[str], float]:
    """The type of an argument that is a positive quantity: a number in its SI unit, or a value with its unit."""

    def quantity(text: str) -> float:
        if not split_unit(text)[1]:
            return positive_number(text)
        try:
            value = parse_value(text, {}, si_unit)
        except InputError as error:
            raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None
        return positive_number(repr(value))

    return quantity


def rounded(value: float, size: float, round_off: float = ROUND_OFF) -> float:
    """A value, or 0 where it is round-off in comparison with the numbers of the given size that cancel in it."""
    return 0.0 if abs(value) <= round_off * size else value


def pace(simulated: float, seconds: float) -> str:
    """How many times faster than real time, with three digits below 10."""
    ratio = simulated / max(seconds, 1e-9)
    return f"{ratio:,.0f}" if ratio >= 10.0 else f"{ratio:.3g}"


def seed_number(text: str) -> int:
    """The type of a seed: a whole number that is not negative."""
    if not text.strip().isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


def text_table(columns: Mapping[str, Sequence[object]], most: int) -> Iterator[str]:
    """The lines of a table of numbers and words, aligned at the right, with at most this number of rows."""
    rows = min(most, max((len(values) for values in columns.values()), default=0))
    texts = [
        [name, *(f"{value:.6g}" if isinstance(value, float) else str(value) for value in values[:rows])]
        for name, values in columns.items()
    ]
    widths = [max(map(len, column)) for column in texts]
    for row in zip(*texts, strict=True):
        yield "  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True))


def print_written(*paths: Path | None) -> None:
    """Say which of the files that were requested are written."""
    for path in paths:
        if path is not None:
            print(f"wrote {path}")


def print_notes(notes: Iterable[str]) -> None:
    """Print each on a line of its own."""
    for note in notes:
        print(f"note: {note}")


def print_undrawn_meshes(mechanism: Mechanism) -> None:
    """Print, to standard error, which meshes a picture lacks and why."""
    if missing := undrawn_meshes(mechanism):
        print(f"note: meshes that are not drawn: {listed(missing)}", file=sys.stderr)


RUN_PLOTS = "energies", "joints", "residual", "reactions", "contacts", "sensors", "phase"
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
