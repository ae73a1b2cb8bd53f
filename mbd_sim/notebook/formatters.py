"""How notebooks show mechanisms and equations, which are plain records that know nothing of pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbd_sim.mechanism.mechanism import Mechanism
    from mbd_sim.studies.symbolic.equations import SymbolicEquations


def register(formatters: Any) -> None:
    """Register the formatters of these types with IPython's, by MIME type; nothing is imported before one is shown."""
    for kind, type_name, shown in FORMATTERS:
        module, _, name = type_name.rpartition(".")
        formatters[kind].for_type_by_name(module, name, shown)


def _mechanism_html(mechanism: Mechanism) -> str:
    from mbd_sim.notebook.runs import mechanism_html

    return mechanism_html(mechanism)


def _mechanism_png(mechanism: Mechanism) -> bytes:
    from mbd_sim.notebook.runs import mechanism_png

    return mechanism_png(mechanism)


def _equations_latex(equations: SymbolicEquations) -> str:
    from mbd_sim.studies.symbolic.latex import screen_latex

    return screen_latex(equations)


FORMATTERS: tuple[tuple[str, str, Callable[[Any], str | bytes]], ...] = (
    ("text/html", "mbd_sim.mechanism.mechanism.Mechanism", _mechanism_html),
    ("image/png", "mbd_sim.mechanism.mechanism.Mechanism", _mechanism_png),
    ("text/latex", "mbd_sim.studies.symbolic.equations.SymbolicEquations", _equations_latex),
)
