"""Stops of joints with several coordinates, each coordinate by itself."""

import math

import pytest

from mbd_sim import MechanismError, Simulation
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.urdf.writer import to_urdf

PUCK = """
mechanism: puck_in_a_frame
gravity: [0, 0, 0]
parts:
  puck: {shape: {type: disc, mass: 2, radius: 0.1}}
joints:
  table:
    type: planar
    between: [ground, puck]
    axis: [0, 0, 1]
    x_axis: [1, 0, 0]
    velocity: [1.3, -0.7, 5]
    limits: [{lower: -0.2, upper: 0.5, restitution: 1}, {lower: -0.3, upper: 0.3, restitution: 0.5}, null]
"""

ROD = """
  rod:
    shape: {type: block, mass: 1.5, size: [0.1, 0.2, 0.6], at: [0.05, 0.02, -0.4]}
"""
CROSS = "{lower: -25 deg, upper: 20 deg, %s}", "{lower: -0.2, upper: 0.4, %s}"
GUIDE = "{lower: -0.4, upper: 0.1, %s}", "{lower: -1, upper: 1.5, %s}"
PAIRS = {
    "universal": ("axes: [[1, 0, 0], [0.3, 1, 0]], velocity: [2, 3]", "revolute", "revolute", CROSS),
    "cylindrical": ("axis: [1, 0, 2], velocity: [0.5, 3]", "prismatic", "revolute", GUIDE),
}


def one_joint(kind, stop):
    keys, _, _, limits = PAIRS[kind]
    both = ", ".join(limit % stop for limit in limits)
    joint = f"  joint: {{type: {kind}, between: [ground, rod], {keys}, limits: [{both}]}}"
    return f"mechanism: one\nparts:\n{ROD}\njoints:\n{joint}\n"


def two_joints(kind, stop):
    """The same mechanism with a massless part between two joints of one coordinate."""
    _, first, second, limits = PAIRS[kind]
    axes, speeds = {
        "universal": (([1, 0, 0], [0.3, 1, 0]), (2, 3)),
        "cylindrical": (([1, 0, 2], [1, 0, 2]), (0.5, 3)),
    }[kind]
    ends, lines = ("ground", "cross", "rod"), []
    for number, (name, axis, speed, limit) in enumerate(zip((first, second), axes, speeds, limits, strict=True)):
        lines.append(
            f"  joint_{number}: {{type: {name}, between: [{ends[number]}, {ends[number + 1]}], axis: {axis}, "
            f"velocity: {speed}, limits: {limit % stop}}}"
        )
    joints = "\n".join(lines)
    return f"mechanism: two\nparts:\n  cross: {{mass: 0}}\n{ROD}\njoints:\n{joints}\n"


def rebounds(x, v, t, lower, upper, e):
    """Position and velocity after the time t between two stops, without forces."""
    while True:
        until = ((upper if v > 0 else lower) - x) / v
        if until >= t:
            return x + v * t, v
        x, t, v = (upper if v > 0 else lower), t - until, -e * v


def test_a_puck_rebounds_from_each_side_of_a_frame_by_itself():
    sim = Simulation.from_text(PUCK, method="tsitouras8")
    sim.run(until=3.0)
    x, y = rebounds(0.0, 1.3, 3.0, -0.2, 0.5, 1.0), rebounds(0.0, -0.7, 3.0, -0.3, 0.3, 0.5)
    assert sim.q == pytest.approx([x[0], y[0], 15.0], abs=1e-12)
    assert sim.u == pytest.approx([x[1], y[1], 5.0], abs=1e-12)
    assert abs(sim.energies.residual) < 1e-13
    assert {event.name for event in sim.contact_events} == {
        f"table.{side}_{end}_limit" for side in "xy" for end in ("lower", "upper")
    }


@pytest.mark.parametrize(
    ("kind", "stop"), [*zip(PAIRS, ("restitution: 0.6", "stiffness: 300, damping: 0.1"), strict=True)]
)
def test_a_joint_with_stops_is_that_of_two_joints_with_stops(kind, stop):
    one, two = (
        Simulation.from_text(one_joint(kind, stop), method="tsitouras8"),
        Simulation.from_text(two_joints(kind, stop), method="tsitouras8"),
    )
    for sim in (one, two):
        sim.run(until=1.5)
    assert one.q == pytest.approx(two.q, abs=1e-10)
    assert one.u == pytest.approx(two.u, abs=1e-9)
    assert len(one.contact_events) == len(two.contact_events)
    if "restitution" in stop:
        assert len(one.contact_events) > 3
        assert abs(one.energies.residual) < 1e-11
    else:
        assert one.energies.dissipated > 0.01


def test_limits_of_one_coordinate_can_be_live():
    sim = Simulation.from_text(
        PUCK, live=["joints.table.limits[0].upper", "joints.table.limits[1].restitution"], method="tsitouras8"
    )
    sim.set_live({"joints.table.limits[0].upper": 0.25, "joints.table.limits[1].restitution": 1.0})
    sim.run(until=2.0)
    assert sim.q[0] == pytest.approx(rebounds(0.0, 1.3, 2.0, -0.2, 0.25, 1.0)[0], abs=1e-12)
    assert sim.q[1] == pytest.approx(rebounds(0.0, -0.7, 2.0, -0.3, 0.3, 1.0)[0], abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[{lower: -0.2", "[{lower: 2", "joints.table.limits[0]: lower 2 is not below upper 0.5. Swap them."),
        (
            "[{lower: -0.2",
            "[{lower: 0.5",
            "joints.table.limits[0]: lower 0.5 is not below upper 0.5. Give a larger upper limit",
        ),
        (", null]", "]", "joints.table.limits: has 2 values, not 3"),
        ("velocity: [1.3", "position: [0.6, 0, 0]\n    velocity: [1.3", "0.1 m beyond its x upper limit"),
        ("axis: [0, 0, 1]\n    x_axis: [1, 0, 0]", "drive: [0, 0, t]\n    axis: [0, 0, 1]", "has a drive and limits"),
    ],
)
def test_wrong_limits_are_named(old, new, message):
    with pytest.raises(MechanismError) as raised:
        Simulation.from_text(PUCK.replace(old, new), method="tsitouras8")
    assert message in str(raised.value)


@pytest.mark.parametrize("kind", ["spherical", "free"])
def test_joints_without_coordinates_of_their_orientation_refuse_limits(kind):
    text = f"mechanism: m\nparts:\n{ROD}\njoints:\n  j:\n    type: {kind}\n    between: [ground, rod]\n    limits: []\n"
    with pytest.raises(MechanismError, match=f"a {kind} joint has no limits.*on_plane"):
        parse_mechanism(text)


def test_urdf_has_the_limits_of_each_coordinate():
    text = to_urdf(parse_mechanism(one_joint("universal", "restitution: 0")))
    assert text.count('type="revolute"') == 2 and f'upper="{math.radians(20)!r}"' in text and 'upper="0.4"' in text
