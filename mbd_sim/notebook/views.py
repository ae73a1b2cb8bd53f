"""Pictures and tables of mechanisms and simulations as HTML and PNG."""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from mbd_sim.analysis.mobility import mobility
from mbd_sim.drawing.picture import draw
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.simulation import Simulation

PICTURE_WIDTH = 420  # px
MAX_COORDINATES = 12  # rows of the table of a simulation

MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".webp": "image/webp"}


def mechanism_html(mechanism: Mechanism) -> str:
    """The picture at the start, the numbers of parts and joints, the mass, and the degrees of freedom."""
    simulation = Simulation(mechanism)
    return _beside(_picture(mechanism, simulation.poses(), ".svg"), mechanism, _summary(simulation))


def mechanism_png(mechanism: Mechanism) -> bytes:
    """The picture at the start."""
    return _picture(mechanism, Simulation(mechanism).poses(), ".png")


def simulation_html(simulation: Simulation) -> str:
    """The picture in the present state, the time, the coordinates and the energies."""
    energies = simulation.energies
    rows = [("time", f"{simulation.time:g} s"), *_coordinates(simulation)]
    rows += [(name, f"{value:.6g} J") for name, value in zip(energies._fields, energies, strict=True)]
    mechanism = simulation.mechanism
    return _beside(_picture(mechanism, simulation.poses(), ".svg"), mechanism, rows)


def simulation_png(simulation: Simulation) -> bytes:
    """The picture in the present state."""
    return _picture(simulation.mechanism, simulation.poses(), ".png")


def embedded(content: bytes, suffix: str, text: str, width: int) -> str:
    """A picture as an element of HTML that contains it; `text` is shown by those who cannot see it."""
    data = base64.b64encode(content).decode()
    return (
        f'<img src="data:{MIME_TYPES[suffix]};base64,{data}" alt="{html.escape(text)}" width="{width}" '
        'style="max-width: 100%; background: white">'
    )


def _summary(simulation: Simulation) -> list[tuple[str, str]]:
    mechanism, equations = simulation.mechanism, simulation.model.equations
    counted = mobility(mechanism, equations.rows, equations.start, simulation.poses())
    energies = simulation.energies
    return [
        ("parts", str(len(mechanism.parts))),
        ("joints", str(len(mechanism.all_joints))),
        ("degrees of freedom", str(counted.degrees_of_freedom)),
        ("mass", f"{mechanism.mass:.6g} kg"),
        ("kinetic energy at the start", f"{energies.kinetic:.6g} J"),
        ("potential energy at the start", f"{energies.potential:.6g} J"),
    ]


def _coordinates(simulation: Simulation) -> list[tuple[str, str]]:
    names, q, u = simulation.coordinate_names, simulation.q, simulation.u
    if len(q) == len(names):
        rows = [(name, f"q = {q[index]:.6g}, u = {u[index]:.6g}") for index, name in enumerate(names)]
    else:  # quaternions have no names of their own
        rows = [(name, f"u = {u[index]:.6g}") for index, name in enumerate(names)]
    return rows if len(rows) <= MAX_COORDINATES else [*rows[:MAX_COORDINATES], ("…", f"{len(rows)} in all")]


def _picture(mechanism: Mechanism, poses: Mapping[str, Pose], suffix: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, f"picture{suffix}")
        draw(mechanism, poses, path)
        return path.read_bytes()


def _beside(picture: bytes, mechanism: Mechanism, rows: Sequence[tuple[str, str]]) -> str:
    text = mechanism.description or mechanism.name
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows)
    return (
        '<div style="display: flex; flex-wrap: wrap; gap: 1em; align-items: center">'
        f"{embedded(picture, '.svg', text, PICTURE_WIDTH)}"
        f"<table><caption>{html.escape(mechanism.name)}</caption><tbody>{cells}</tbody></table></div>"
    )
