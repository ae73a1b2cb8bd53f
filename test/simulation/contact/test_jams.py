"""Drives that press where nothing can yield: an error in all axes, also where round-off yields a little."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import DivergedError
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.files.load import parse_mechanism
from mbd_sim.simulation.contact.stepper import EventError

GENEVA = Path(__file__).parents[3] / "config" / "contacts" / "geneva_slots.yaml"
PIVOT = """
parts:
  pin: {{shape: {{type: sphere, mass: 1, radius: 0.01}}}}
  wheel: {{shape: {shape}}}
joints:
  pin: {{type: prismatic, between: [ground, pin], axis: {x}, drive: 0.3 - t}}
  wheel: {{type: revolute, between: [ground, wheel], axis: {z}}}
contacts:
  c: {{between: [pin, wheel], restitution: 0.3, friction: {friction}}}
"""
BLOCK = "{{type: block, mass: 1, size: [0.2, 0.2, 0.02], rotate: {rotate}}}"
CRANK = """
parts:
  crank: {{mass: 1, inertia: [0.01, 0.01, 0.01], center: [0, 0, 0], points: {{pin: {pin}}}}}
  rod: {{mass: 1, inertia: [0.01, 0.01, 0.01], center: [0, 0, 0], points: {{end: {end}}}}}
  slider: {{shape: {{type: sphere, mass: 1, radius: 0.05}}}}
ground: {{points: {{wall: {wall}}}}}
joints:
  crank: {{type: revolute, between: [ground, crank], axis: {z}, drive: 2.6 + 3*t}}
  pin: {{type: revolute, between: [crank.pin, rod], axis: {z}}}
  end: {{type: revolute, between: [rod.end, slider], axis: {z}}}
  slide: {{type: prismatic, between: [ground, slider], axis: {x}, position: 0.2, guess: true}}
contacts:
  c: {{parts: [slider], plane: ground.wall, normal: {back}, restitution: 0.3, friction: {friction}}}
"""
PUSHED = """
parts:
  pusher: {{shape: {{type: sphere, mass: 1, radius: 0.05}}}}
  ball: {{shape: {{type: sphere, mass: 1, radius: 0.05}}}}
ground: {{points: {{wall: {far}}}}}
joints:
  pusher: {{type: prismatic, between: [ground, pusher], axis: {x}, drive: t}}
  ball: {{type: prismatic, between: [ground, ball], axis: {x}, position: 0.3}}
contacts:
  c: {{between: [pusher, ball], friction: {friction}}}
  wall: {{parts: [ball], plane: ground.wall, normal: {back}, friction: {friction}}}
"""
JAMS = {
    "a pin that presses on a block towards its pivot": (PIVOT.replace("{shape}", BLOCK), "0.19 s the gap of c is", "pin"),
    "a loop that presses on a wall": (CRANK, r"0\.362\d* s the gap of c is", "crank"),
    "a ball between a drive and a wall": (PUSHED, "0.35 s the gaps of c, wall are", "pusher"),
}  # fmt: skip
VECTORS = {
    "x": (1, 0, 0), "z": (0, 0, 1), "back": (-1, 0, 0), "pin": (0.1, 0, 0), "end": (0.3, 0, 0),
    "wall": (0.26, 0, 0), "far": (0.5, 0, 0),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "angle", "friction"), [
    (kind, *((0.8, 0.0), (0.0, 0.3))[index % 2]) for index, kind in enumerate(JAMS)
])  # fmt: skip
def test_a_drive_that_presses_where_nothing_yields_is_named(kind, angle, friction):
    """In turned axes the gap's gradient is round-off and not zero: the impulse was 1e11 times too large, or more."""
    text, gaps, drive = JAMS[kind]
    turned = rot.about(rot.unit((1, 2, 3)), angle)
    vectors = {name: (turned @ np.array(vector)).tolist() for name, vector in VECTORS.items()}
    rotate = f"{{axis: [1, 2, 3], angle: {angle}}}"
    text = text.format(**vectors, rotate=rotate, friction=friction)
    simulation = Simulation(parse_mechanism(f"mechanism: jam\ngravity: [0, 0, 0]\n{text}"), method="tsitouras8")
    with pytest.raises(EventError, match=f"at {gaps} closed by the drive of {drive} alone.* compliant contact"):
        simulation.run(until=0.6)
    assert np.all(np.abs(simulation.u) < 10.0)  # the state before it


def test_a_driven_pin_at_the_bottom_of_a_slot_that_is_too_short_ends_the_run():
    """The wheel turned by 307 rad within a step, since less and less of the force turns it, and the run went on."""
    text = GENEVA.read_text().replace("[0.38*R, -pin - c]", "[0.55*R, -pin - c]")
    text = text.replace("{to: [0.38*R, pin + c], through: [0.38*R", "{to: [0.55*R, pin + c], through: [0.55*R")
    simulation = Simulation(parse_mechanism(text), method="tsitouras8")
    room = r"between t = 0.451 s .* leave room for what the drive of driver presses on them: .*driver_pin_on_wheel_1"
    with pytest.raises(DivergedError, match=room):
        simulation.run(until=0.5)
    assert 0.5 < simulation.q[0] < 0.7
