"""The options of `mbd_sim check` that say how a mechanism is drawn."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.cli.shared.common import add_repeatable, print_undrawn_meshes
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.simulation.run.simulation import BaseSimulation

_OF_PLANS = ("sheet", "scale", "dimension", "title")


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """Declare `--draw` and what belongs to it."""
    group = parser.add_argument_group("drawing")
    group.add_argument(
        "--draw", metavar="PICTURE", help="draw the initial configuration to a .png, .svg, .pdf or .dxf file"
    )
    group.add_argument("--sheet", metavar="NAME", help="on a sheet with frame and title block: A4, A3, 'A4 portrait' …")
    group.add_argument(
        "--scale", metavar="1:N", help="true scale on the sheet, such as 1:5 (default: the largest that fits)"
    )
    add_repeatable(
        group,
        "--dimension",
        "WHAT",
        "a dimension between joints and points: A,B (length), x:A,B, y:A,B, angle:A,V,B, angle:A,B (from the "
        "horizontal), or auto for links and supports; repeatable",
    )
    group.add_argument("--title", help="in the title block (default: the name of the mechanism)")


def require_drawing(options: argparse.Namespace) -> None:
    """Refuse options about a drawing that is not made.

    :raises InputError: nothing is drawn.
    """
    given = [f"--{name}" for name in _OF_PLANS if getattr(options, name)]
    if given and not options.draw:
        raise InputError(f"{', '.join(given)}: nothing is drawn", "Give --draw too.")


def draw_requested(
    options: argparse.Namespace,
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    simulation: BaseSimulation | None = None,
) -> None:
    """Draw the mechanism if that is requested: on a sheet to scale, or as large as it fits.

    The closed contacts of a simulation are drawn with their forces.

    :raises InputError: the drawing is not possible.
    """
    if not options.draw:
        return
    if options.draw.lower().endswith(".dxf") or any(getattr(options, name) for name in _OF_PLANS):
        from mbd_sim.pictures.technical.plan import make_plan
        from mbd_sim.pictures.technical.written import draw_plan

        plan = make_plan(
            mechanism,
            poses,
            sheet=options.sheet or "A4",
            at_scale=options.scale or "",
            dimensions=options.dimension,
            title=options.title or "",
        )
        draw_plan(plan, options.draw)
    else:
        from mbd_sim.pictures.drawing.picture import draw
        from mbd_sim.pictures.shapes.touching import NONE_TOUCHING, touching_now

        draw(mechanism, poses, options.draw, contacts=touching_now(simulation) if simulation else NONE_TOUCHING)
    print_undrawn_meshes(mechanism)
