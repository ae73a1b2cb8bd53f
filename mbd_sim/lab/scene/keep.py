"""A motion as one HTML file, which opens without a server and without a network."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.scene.camera import aim
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.server.server import Gate, started, stop
from mbd_sim.lab.session.frames import Frame
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.touching import touching
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.run_point import RunPoint
from mbd_sim.simulation.run.simulation import BaseSimulation

PLOT = '<div style="position:fixed;left:12px;bottom:52px;width:min(34vw,420px);z-index:9">{}</div>'
PICTURES = 30.0  # per second of the motion
MOST_CURVES = 8


def write_html(mechanism: Mechanism, path: Path, duration: float, *, dark: bool) -> None:
    """Write a page with the motion of a mechanism from its start, for a `duration` in s.

    :raises DivergedError: the motion would become infinite.
    """
    simulation = BaseSimulation(mechanism)
    stride = max(1, round(1.0 / (PICTURES * simulation.step_size)))
    points = [(simulation.time, simulation.snapshot())]
    while simulation.time < duration - 0.5 * simulation.step_size:
        simulation.step(stride)
        points.append((simulation.time, simulation.snapshot()))
    path.write_text(motion_html(simulation.model, points, dark=dark), encoding="utf-8")


def mechanisms_at(model: Model, points: list[tuple[float, RunPoint]]) -> list[Mechanism]:
    """The mechanism at each point of a run, with the live values that it had there."""
    found: dict[tuple[tuple[str, float], ...], Mechanism] = {}
    mechanisms = []
    for _, point in points:
        values = tuple(point.live.items())
        if values not in found:
            found[values] = with_values(model.mechanism, dict(values)) if values else model.mechanism
        mechanisms.append(found[values])
    return mechanisms


def motion_html(model: Model, points: list[tuple[float, RunPoint]], *, dark: bool, page: Scene | None = None) -> str:
    """The motion through points of a run, with their times in s, and the plots of coordinates and energies.

    :param page: a scene whose choice of traces and paths is taken over.
    """
    server = started(Gate("127.0.0.1"), "127.0.0.1", 0)
    try:
        extent = extent_of(model)
        scene = Scene(server.scene, model, extent, None, dark=dark, in_file=True)
        if page is not None:
            scene.look_like(page)
        aim(server.initial_camera, extent)
        mechanisms = mechanisms_at(model, points)
        scene.draw_ahead([*mechanisms, *mechanisms[:1]])
        serializer = server.get_scene_serializer()
        before = points[0][0] if points else 0.0
        for (time, point), mechanism in zip(points, mechanisms, strict=True):
            serializer.insert_sleep(max(time - before, 0.0))
            before = time
            scene.show(_frame(model, mechanism, time, point))
        html: str = serializer.as_html(dark_mode=dark)
    finally:
        stop(server)
    end = html.rindex("</body>")
    return html[:end] + PLOT.format(_plots(model, points, dark)) + html[end:]


def _frame(model: Model, mechanism: Mechanism, time: float, point: RunPoint) -> Frame:
    now = time, point.state, point.inputs
    return Frame(
        generation=1,
        number=0,
        mechanism=mechanism,
        time=time,
        running=False,
        rate=0.0,
        speed=1.0,
        poses=model.pose_array(*now).copy(),
        contacts=touching(model, *now),
        energies=np.zeros(7),
        q=np.empty(0),
        positions=np.empty(0),
        speeds=np.empty(0),
        watched={},
        pull=None,
        span=(0.0, 0.0),
        message="",
        recording="",
        values={},
    )


def _plots(model: Model, points: list[tuple[float, RunPoint]], dark: bool) -> str:
    """The plots as SVG."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    ink = "#dddddd" if dark else "#222222"
    colors = dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.edgecolor"), ink)
    with rc_context({**colors, "font.size": 8}):
        names = model.coordinate_names
        rotates = [model.mechanism.coordinate(name).rotation for name in names]
        units = list(dict.fromkeys(rotates[:MOST_CURVES]))  # a plot for each
        figure = Figure(figsize=(4.2, 1.7 * (len(units) + 1)), layout="constrained")
        *upper, lower = figure.subplots(len(units) + 1, 1, sharex=True, squeeze=False)[:, 0]
        times = [time for time, _ in points]
        places = np.array([model.coordinates(point.state) for _, point in points]).reshape(len(points), -1)
        energies = np.array([tuple(model.energies(t, p.state, p.start_energy, p.inputs)) for t, p in points])
        for axes, turning in zip(upper, units, strict=True):
            axes.set_ylabel("deg" if turning else "m")
            for name, rotation, column in list(zip(names, rotates, places.T, strict=True))[:MOST_CURVES]:
                if rotation == turning:
                    axes.plot(times, np.degrees(column) if turning else column, label=name, linewidth=1)
        for name, column in zip(
            ("kinetic", "potential", "dissipated"), energies.reshape(len(points), -1).T, strict=False
        ):
            lower.plot(times, column, label=name, linewidth=1)
        lower.set_ylabel("J")
        lower.set_xlabel("t (s)")
        for axes in (*upper, lower):
            axes.patch.set_alpha(0.0)
            axes.legend(fontsize=6, frameon=False, labelcolor=ink)
        text = io.StringIO()
        figure.savefig(text, format="svg", transparent=True)
    svg = text.getvalue()
    return svg[svg.index("<svg") :].replace("<svg ", '<svg style="width:100%;height:auto" ', 1)
