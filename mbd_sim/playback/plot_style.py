"""How plots look: width, fonts and colors for a screen, a slide or a printed page, on a light or a dark ground."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mbd_sim.appearance.palette import Color, mixed
from mbd_sim.errors import InputError, nearest

THEMES = ("light", "dark")
DASHES = ("-", "--", "-.", ":")  # of printed lines, which may have no colors
_WHITE: Color = (255, 255, 255)
_DARK_GROUND, _DARK_TEXT, _DARK_RULES = "#131416", "#e6e8ec", "#5a606a"
_BRIGHT = 150  # largest component above which a color is visible on a dark ground


@dataclass(frozen=True)
class PlotStyle:
    """The style of a plot: sizes in inches, points and pixels per inch."""

    name: str
    width: float
    double_width: float  # of plots in two columns
    panel_height: float  # of a panel over time; that of a phase portrait is twice as large
    font: float
    line: float
    resolution: int
    titled: bool = True  # the plot and its panels have titles; a figure in a paper has a caption instead
    dashed: bool = False
    theme: str = "light"

    def color(self, color: Color) -> str:
        """A color as Matplotlib and HTML write it, which is visible on the ground of the theme."""
        if self.theme == "dark":
            color = mixed(color, _WHITE, 0.2 if max(color) > _BRIGHT else 0.8)
        return f"#{color[0]:02x}{color[1]:02x}{color[2]:02x}"

    def dash(self, number: int) -> str:
        """The dashes of the line of a number in its panel."""
        return DASHES[number % len(DASHES)] if self.dashed else "-"

    def legend(self, axes: Any, count: int) -> None:
        """Name the `count` lines outside the axes: on the right, or above them where the width is scarce."""
        if self.titled:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
        else:
            axes.legend(
                loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(count, 3), frameon=False, fontsize="small"
            )

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Draw with Matplotlib in this style rather than in the user's own."""
        from matplotlib import style

        settings: dict[str, Any] = {
            "font.size": self.font,
            "lines.linewidth": self.line,
            "axes.linewidth": 0.6 * self.line,
            "axes.titlesize": "medium",
            "axes.labelsize": "medium",
            "svg.fonttype": "none",
            "grid.alpha": 0.3,
        }
        if self.theme == "dark":
            settings |= dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), _DARK_GROUND)
            text = ("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.titlecolor")
            settings |= dict.fromkeys(text, _DARK_TEXT) | dict.fromkeys(("axes.edgecolor", "grid.color"), _DARK_RULES)
        with style.context(["default", settings]):
            yield


STYLES = {
    "screen": PlotStyle("screen", width=9.0, double_width=11.0, panel_height=2.0, font=10.0, line=1.2, resolution=110),
    "slide": PlotStyle("slide", width=10.0, double_width=13.3, panel_height=2.6, font=16.0, line=2.2, resolution=192),
    "paper": PlotStyle(
        "paper",
        width=3.5,
        double_width=7.2,
        panel_height=1.4,
        font=8.0,
        line=0.9,
        resolution=300,
        titled=False,
        dashed=True,
    ),
}


def plot_style(path: Path, name: str = "screen", theme: str = "light") -> PlotStyle:
    """The style for a file.

    :raises InputError: there is no such style or theme, or the file is an HTML page and the style is not `screen`.
    """
    if name not in STYLES:
        raise InputError(f"there is no style {name!r} of plots", nearest(name, STYLES))
    if theme not in THEMES:
        raise InputError(f"there is no theme {theme!r} of plots", nearest(theme, THEMES))
    if path.suffix == ".html" and name != "screen":
        raise InputError(
            f"{path}: the style {name} has a fixed width, but an HTML page is as wide as its window",
            "Choose a .png, .svg or .pdf file.",
        )
    return replace(STYLES[name], theme=theme)


def template(theme: str) -> str:
    """The template of Plotly for a theme."""
    return "plotly_dark" if theme == "dark" else "plotly_white"
