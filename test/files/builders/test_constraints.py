"""What may be wrong with the constraints of a file, before anything is assembled; and what they become."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.elements import constraints as c

TEXT = """
mechanism: two_bodies
parameters: {r: 0.2}
ground: {points: {o: [0, 0, 1], turned: {at: [0, 0, 1], rotate: {axis: [0, 0, 1], angle: 90 deg}}}}
parts:
  a: {mass: 1, inertia: [1, 1, 1], points: {p: [1, 0, 0], q: [2, 0, 0], r: {rotate: {axis: [1, 0, 0], angle: 90 deg}}}}
  b: {mass: 1, inertia: [1, 1, 1], points: {p: [0, 1, 0]}}
joints:
  slide: {type: prismatic, between: [ground, a], axis: [1, 0, 0]}
  spin: {type: revolute, between: [a, b], axis: [0, 0, 1]}
  ball: {type: spherical, between: [b, c]}
  rod: {type: cylindrical, between: [ground, d], axis: [0, 0, 1]}
constraints:
  k: CONSTRAINT
"""
TEXT = TEXT.replace("joints:\n", "  c: {mass: 1, inertia: [1, 1, 1]}\n  d: {mass: 1, inertia: [1, 1, 1]}\njoints:\n")
LINE = 1 + next(number for number, line in enumerate(TEXT.splitlines()) if "CONSTRAINT" in line)


def read(constraint):
    return parse_mechanism(TEXT.replace("CONSTRAINT", constraint))


def record(constraint):
    (found,) = read(constraint).constraints
    return found


MISTAKES = {
    "a coordinate that is not there": ("{type: gear, joints: [spin, spinn], radii: [1, 2]}", "constraints.k.joints", "there is no joint coordinate 'spinn'", "'spin'"),
    "a joint with several coordinates": ("{type: rack, pinion: rod, rack: slide, radius: 1}", "constraints.k", "'rod' has 2 coordinates", "rod.angle"),
    "an angular velocity": ("{type: coupling, terms: {spin: 1, ball.rx: 1}}", "constraints.k.terms", "'ball.rx' is a component of an angular velocity", "revolute, universal"),
    "a joint coupled with itself": ("{type: gear, joints: [spin, spin], radii: [1, 2]}", "constraints.k.joints", "couples 'spin' with itself", "Name two joints."),
    "a rack that is its pinion": ("{type: rack, pinion: slide, rack: slide, radius: 1}", "constraints.k", "couples 'slide' with itself", "Name two joints."),
    "a factor of zero": ("{type: coupling, terms: {spin: 0, slide: 1}}", "constraints.k.terms.spin", "has the factor 0", "Leave it out."),
    "a radius of zero": ("{type: gear, joints: [spin, slide], radii: [0, 1]}", "constraints.k.radii[0]", "must be greater than 0", "positive"),
    "one radius": ("{type: gear, joints: [spin, slide], radii: [1]}", "constraints.k.radii", "has 1 value", ""),
    "points of one part": ("{type: distance, between: [a.p, a.q], length: 1}", "constraints.k.between", "connects 'a' with itself", "Name points of different parts."),
    "a cable on one part": ("{type: cable, through: [a.p, a.q, a], length: 1}", "constraints.k.through", "connects 'a' with itself", "different parts"),
    "a cable with one end": ("{type: cable, through: [a.p], length: 1}", "constraints.k.through", "", ""),
    "a point on a plane of its own part": ("{type: on_plane, point: a.p, plane: a}", "constraints.k.point", "connects 'a' with itself", "different parts"),
    "a point that is not there": ("{type: on_plane, point: a.x}", "constraints.k.point", "'a' has no point 'x'", "p, q, r"),
    "a part that is not there": ("{type: rolling, wheel: wheel, radius: 1}", "constraints.k.wheel", "there is no part 'wheel'", ""),
    "a second end that is not there": ("{type: distance, between: [a.p, b.x], length: 1}", "constraints.k.between[1]", "'b' has no point 'x'", "Valid: p."),
    "a curve with one equation": ("{type: on_curve, point: a, equation: x}", "constraints.k", "needs 'equations'", "A curve has two: equations."),
    "a surface with two equations": ("{type: on_surface, point: a, equations: [x, y]}", "constraints.k", "needs 'equation'", "A surface has one: equation."),
    "an unknown name in an equation": ("{type: on_surface, point: a, equation: x + w}", "constraints.k.equation", "unknown name 'w'", ""),
    "code in an equation": ("{type: on_surface, point: a, equation: \"__import__('os')\"}", "constraints.k.equation", "unknown name 'os'", ""),
    "a length in seconds": ("{type: distance, between: [a, b], length: 1 s}", "constraints.k.length", "", ""),
    "a direction of zeros": ("{type: on_line, point: a, direction: [0, 0, 0]}", "constraints.k.direction", "", ""),
    "a line without direction": ("{type: on_line, point: a}", "constraints.k", "'direction' is missing", "Add it."),
    "a type that is not there": ("{type: rollin, wheel: a, radius: 1}", "constraints.k.type", "unknown type 'rollin'", "'rolling'"),
    "an unknown key": ("{type: rolling, wheel: a, radius: 1, slip: 0}", "constraints.k.slip", "unknown key 'slip'", ""),
    "no type": ("{wheel: a, radius: 1}", "constraints.k", "'type' is missing", ""),
}  # fmt: skip


@pytest.mark.parametrize(("text", "key", "message", "remedy"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_with_its_key_and_remedy(text, key, message, remedy):
    with pytest.raises(MechanismError) as caught:
        read(text)
    (problem,) = caught.value.problems
    assert problem.line == LINE
    assert problem.key == key
    assert message in problem.message
    assert remedy in problem.remedy
    assert problem.message


def test_coordinates_are_not_looked_up_while_a_joint_cannot_be_read():
    """Whether 'slide' has one is not known."""
    text = TEXT.replace("CONSTRAINT", "{type: gear, joints: [spin, slide], radii: [1, 2]}")
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text.replace("type: prismatic", "type: prismatik"))
    assert [problem.key for problem in caught.value.problems] == ["joints.slide.type"]


def test_gears_turn_against_each_other_and_with_each_other_inside():
    outer = record("{type: gear, joints: [spin, rod.angle], radii: [r, 0.5]}")
    inner = record("{type: gear, joints: [spin, rod.angle], radii: [r, 0.5], internal: true}")
    assert outer.factors == {"spin": 0.2, "rod.angle": 0.5}
    assert inner.factors == {"spin": 0.2, "rod.angle": -0.5}
    assert outer.kind == inner.kind == "gear"


def test_a_rack_moves_forward_with_its_pinion_or_backwards():
    assert record("{type: rack, pinion: spin, rack: slide, radius: r}").factors == {"spin": -0.2, "slide": 1.0}
    assert record("{type: rack, pinion: spin, rack: slide, radius: r, reverse: true}").factors["spin"] == 0.2


def test_directions_are_turned_with_the_frames_that_carry_them():
    flat = record("{type: on_plane, point: a, plane: ground.turned, normal: [2, 0, 0]}")
    assert isinstance(flat, c.Flat)
    assert flat.normals == pytest.approx(np.array([[0.0, 1.0, 0.0]]), abs=1e-15)
    assert flat.base.point.tolist() == [0.0, 0.0, 1.0]
    line = record("{type: on_line, point: a, line: ground.turned, direction: [1, 0, 0]}")
    assert line.normals @ [0.0, 1.0, 0.0] == pytest.approx(np.zeros(2), abs=1e-15)
    assert line.normals @ line.normals.T == pytest.approx(np.eye(2), abs=1e-15)
    blade = record("{type: knife_edge, at: a.r, direction: [0, 1, 0], plane: ground.turned, normal: [0, 1, 0]}")
    assert blade.direction == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert blade.normal == pytest.approx([-1.0, 0.0, 0.0], abs=1e-15)
    wheel = record("{type: rolling, wheel: a.r, axis: [0, 3, 0], radius: r, plane: ground.turned}")
    assert wheel.axis == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert (wheel.radius, wheel.normal.tolist()) == (0.2, [0.0, 0.0, 1.0])


def test_what_is_left_out_stands_on_the_ground():
    assert record("{type: rolling, wheel: a, radius: 1}").axis is None
    assert record("{type: on_plane, point: a}").base.part == "ground"
    assert record("{type: on_plane, point: a}").normals.tolist() == [[0.0, 0.0, 1.0]]


def test_a_cable_may_pass_over_points_of_the_same_part():
    cable = record("{type: cable, through: [ground.o, a.p, a.q, b], length: 3 + 0.1*t}")
    assert [point.part for point in cable.points] == ["ground", "a", "a", "b"]
    assert cable.length.at(2.0) == pytest.approx(3.2)


@pytest.mark.parametrize(("constraint", "where", "words"), [
    ("{type: distance, between: [a.p, b.p], length: 1, restitution: 0.5}", "k",
     "restitution has no effect without a bound. Add 'bound: at_least' or 'bound: at_most'."),
    ("{type: on_plane, point: a.p, bound: at_least, restitution: 1.2}", "k.restitution", "must be at most 1"),
    ("{type: on_plane, point: a.p, bound: at_least, friction: -0.1}", "k.friction", "must be at least 0"),
    ("{type: on_plane, point: a.p, bound: at_least, static_friction: 0.4}", "k", "static_friction needs friction"),
    ("{type: on_plane, point: a.p, bound: at_least, friction: 0.5, static_friction: 0.4}", "k",
     "static_friction 0.4 is less than friction 0.5"),
    ("{type: on_plane, point: a.p, bound: above}", "k.bound", "at_least"),
    ("{type: on_curve, point: a.p, equations: [x, y], bound: at_least}", "k", "a curve has no sides"),
    ("{type: rolling, wheel: a.p, radius: r, static_friction: 1}", "k", "static_friction needs friction"),
    ("{type: coupling, terms: {slide: 1, spin: -1}, restitution: 0.5}", "k", "no effect without backlash"),
    ("{type: coupling, terms: {slide: 1, spin: -1}, backlash: 1, bound: at_most}", "k", "has both bound and backlash"),
    ("{type: coupling, terms: {slide: 1}, bound: at_most, friction: 1}", "k", "friction and slip belong together"),
    ("{type: coupling, terms: {slide: 1, spin: 1}, slip: {spin: 1}, friction: 1}", "k", "no effect without a bound"),
    ("{type: coupling, terms: {slide: 1}, bound: at_most, friction: 1, slip: {wheel: 1}}", "k.slip",
     "there is no joint coordinate 'wheel'"),
    ("{type: coupling, terms: {slide: 1, spin: -1}, backlash: 0}", "k.backlash", "must be greater than 0"),
    ("{type: clutch, terms: {spin: 1}}", "k", "has neither one_way nor a capacity"),
    ("{type: clutch, terms: {spin: 1}, one_way: true, capacity: 3}", "k", "has both one_way and a capacity"),
    ("{type: clutch, terms: {spin: 1}, one_way: true, static: 2}", "k", "a one-way clutch has no static friction"),
    ("{type: clutch, terms: {spin: 1}, capacity: 2, static: 0.5}", "k.static", "must be at least 1"),
    ("{type: clutch, terms: {wheel: 1}, capacity: 2}", "k.terms", "there is no joint coordinate 'wheel'"),
])  # fmt: skip
def test_one_sided_constraints_that_make_no_sense_are_refused_with_their_line(constraint, where, words):
    with pytest.raises(MechanismError) as raised:
        parse_mechanism(TEXT.replace("CONSTRAINT", constraint))
    message = str(raised.value)
    assert f":{LINE}: constraints.{where}" in message
    assert words in message


def test_one_sided_constraints_become_records_with_a_law():
    text = TEXT.replace(
        "CONSTRAINT",
        "{type: on_plane, point: a.p, bound: at_most, friction: r, restitution: 0.3}\n"
        "  gear: {type: gear, joints: [spin, rod.angle], radii: [1, 2], backlash: 2 mm, restitution: 0.1}",
    )
    plane, gear = parse_mechanism(text).constraints
    assert (plane.bound, plane.law.restitution, plane.law.friction, plane.law.static_friction) == (
        "at_most", 0.3, 0.2, 0.2,
    )  # fmt: skip
    assert (gear.play.half, gear.play.restitution) == (0.001, 0.1)
