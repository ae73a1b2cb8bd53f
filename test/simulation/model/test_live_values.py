import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError, MechanismError
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.simulation.model import live_values
from mbd_sim.simulation.model.live_values import LiveValues, names_with_matches


def test_a_live_value_moves_the_mechanism_as_one_built_with_it():
    changes = {"gravity[2]": -3.0, "parameters.m": 2.0, "joints.elbow.damping": 0.3}
    live = Simulation.from_file("double_rod", live=["gravity[2]", "parameters.*", "joints.*.damping"])
    assert live.live == {
        "gravity[2]": -9.81, "parameters.m": 1.0, "parameters.l": 1.0,
        "joints.shoulder.damping": 0.0, "joints.elbow.damping": 0.0,
    }  # fmt: skip
    live.set_live(changes)
    live.reset()
    built = Simulation(with_values(load_mechanism("double_rod"), changes))
    live.run(2.0)
    built.run(2.0)
    assert live.q == pytest.approx(built.q, abs=1e-11)
    assert live.energies == pytest.approx(built.energies, abs=1e-10)


def test_a_change_on_the_way_keeps_the_audit():
    sim = Simulation.from_file("cart_pendulum_spring", live=["gravity[2]", "joints.*"])
    sim.run(1.0)
    sim.set_live({"gravity[2]": -4.0})
    assert abs(sim.energies.residual) < 1e-12
    sim.run(2.0)
    assert abs(sim.energies.residual) < 1e-11


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters.k": 1.0}, "not a live value"),
        ({"parameters.m": -1.0}, "at least 0"),
        ({"parameters.l": float("nan")}, "finite"),
        ({"parameters.l": 2.0, "gravity[2]": float("inf")}, "finite"),
    ],
)
def test_a_change_that_does_not_fit_is_rejected_whole(changes, words):
    sim = Simulation.from_file("double_rod", live=["gravity[2]", "parameters.*"])
    before, inputs = sim.live, sim.inputs.copy()
    with pytest.raises(CommandError, match=words):
        sim.set_live(changes)
    assert sim.live == before
    assert np.array_equal(sim.inputs, inputs)


def test_a_value_that_is_not_live_is_refused_with_the_way_to_make_it_so():
    sim = Simulation.from_file("double_rod")
    remedy = r"Simulation\(\.\.\., live=\['parameters\.l'\]\), or the parameter `live` of sim_node"
    with pytest.raises(CommandError, match=rf"'parameters\.l' is not a live value\. .*{remedy}"):
        sim.set_live({"parameters.l": 1})
    some = Simulation.from_file("double_rod", live=["gravity[2]"])
    with pytest.raises(CommandError, match=r"Simulation\(\.\.\., live=\[…, 'parameters\.l'\]\)"):
        some.set_live({"parameters.l": 1})
    with pytest.raises(CommandError, match=r"'parameters\.ll' is not a live value\. Did you mean 'l'\?"):
        sim.set_live({"parameters.ll": 1})


def test_a_change_must_not_open_loops():
    sim = Simulation.from_file("four_bar", live=["parameters.crank", "parameters.density"])
    sim.run(0.5)
    with pytest.raises(CommandError, match="open the loops by"):
        sim.set_live({"parameters.crank": 0.6})
    sim.set_live({"parameters.density": 1.5})
    sim.run(1.0)
    assert sim.violation.position < 1e-11


def test_lengths_of_loops_may_change_before_a_new_start():
    sim = Simulation.from_file("four_bar", live=["parameters.crank"])
    values = sim._live.prepare({"parameters.crank": 0.45}).inputs
    q, u = sim.model.consistent(sim.q, sim.u, values)
    other = Simulation(with_values(load_mechanism("four_bar"), {"crank": 0.45}))
    assert np.abs(other.model.equations.constraints.position(0.0, q)).max() < 1e-10
    assert np.abs(other.model.equations.constraints.gradient(0.0, q) @ u).max() < 1e-10


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("joints.elbow.axis[0]", "built into the equations"),
        ("joints.elbow.type", "not a number"),
        ("joints.elbow.position", "do not depend on it"),
        ("joints.elbw.damping", "elbow"),
    ],
)
def test_the_error_for_a_value_that_cannot_be_live_says_why(key, words):
    with pytest.raises(MechanismError, match=words):
        Simulation.from_file("double_rod", live=[key])


def test_sizes_of_bodies_with_changing_features_are_built_into_the_equations():
    """A node takes all parameters as live values that it can; `r` is the radius of a roller on an outline."""
    text = """
mechanism: roller
parameters: {r: 0.01, k: 20}
parts:
  roller: {shape: {type: sphere, radius: r, mass: 1}}
  cam: {shape: {type: outline, mass: 1, points: [[-0.1, -0.1], [0.1, -0.1], [0, 0.1]]}}
joints:
  roller: {type: prismatic, between: [ground, roller], axis: [1, 0, 0], position: 0.3, stiffness: k}
  cam: {type: revolute, between: [ground, cam], axis: [0, 0, 1]}
contacts: {c: {between: [roller, cam]}}
"""
    names = names_with_matches(mechanism := parse_mechanism(text), ["parameters.*"])
    live = LiveValues(mechanism, names).current
    assert "parameters.k" in live and "parameters.r" not in live


def test_patterns_pass_over_the_numbers_inside_expressions():
    sim = Simulation.from_file("duffing", live=["forces.*", "gravity[*]"])
    assert not any("names" in key for key in sim.live)
    sim.run(0.01)
    with pytest.raises(MechanismError, match=r"forces\.\*: no number of the file has such a key"):
        Simulation.from_file("box_kite", live=["forces.*"])


def test_a_pattern_that_matches_nothing_is_an_error_with_the_nearest_key():
    with pytest.raises(MechanismError, match=r"double_rod.yaml: joints\.\*\.dampin: .*'joints.elbow.damping'"):
        Simulation.from_file("double_rod", live=["gravity[2]", "joints.*.dampin"])
    with pytest.raises(
        MechanismError, match=r"gravity: .*not a number\. Name one .*'gravity\[0\]', or 'gravity\[\*\]'"
    ):
        Simulation.from_file("double_rod", live=["gravity"])
    names = ["forces.*", "gravity[*]", "no_such", "joints.*.damping"]
    assert names_with_matches(load_mechanism("box_kite"), names) == ["gravity[*]", "no_such", "joints.*.damping"]


def test_a_name_that_a_pattern_also_matches_is_an_error_if_it_cannot_be_live():
    text = FOLLOWING.replace("parameters: {", "parameters: {unused: 3, ")
    with pytest.raises(MechanismError, match=r"unused: cannot change during a run: the equations of motion do not"):
        Simulation.from_text(text, live=["parameters.*", "unused"])


def test_a_live_value_may_be_given_by_any_of_its_names_and_with_a_unit():
    sim = Simulation.from_file("double_rod", live=["m", "parameters.*", "joints.elbow.damping"])
    assert list(sim.live) == ["m", "parameters.l", "joints.elbow.damping"]
    sim.set_live({"parameters.m": "500 g", "l": np.float32(0.5), "joints.elbow.damping": "1 N*mm*s/rad"})
    assert sim.live == {"m": 0.5, "parameters.l": 0.5, "joints.elbow.damping": 1e-3}


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("3 s", r"the unit 's' does not fit: a value in N\*m\*s/rad is expected here \(got '3 s'\)\. Write .*0\.5 N"),
        ("thick", "unknown name 'thick'"),
        ("", "not a number"),
        (True, r"must be a number \(got True\)"),
        (None, "has no value"),
        ([1.0, 2.0], "must be a number"),
        (float("inf"), "must be finite"),
    ],
)
def test_the_error_for_a_value_that_is_no_number_names_it(value, words):
    sim = Simulation.from_file("double_rod", live=["joints.elbow.damping", "m"])
    with pytest.raises(CommandError, match=f"^joints.elbow.damping: {words}"):
        sim.set_live({"m": 2.0, "joints.elbow.damping": value})
    assert sim.live["m"] == 1.0
    with pytest.raises(CommandError, match="'m' is given twice"):
        sim.set_live({"m": 2.0, "parameters.m": 3.0})


LIMITED = """
mechanism: limited
parameters: {strength: 2, slack: 0.1}
parts: {arm: {mass: 1, center: [0, 0, -0.5], inertia: [0.1, 0.1, 0.1]}}
joints:
  hip: {type: revolute, between: [ground, arm], axis: [0, 1, 0], effort_limit: strength, damping: slack*strength}
"""


def test_effort_limits_follow_live_values_also_in_copies_and_restored_states():
    sim = Simulation.from_text(LIMITED, live=["parameters.strength"])
    before = sim.snapshot()
    sim.set_live({"parameters.strength": 5.0})
    sim.set_efforts([4.0])
    assert sim.efforts.tolist() == sim.copy().efforts.tolist() == [4.0]
    copied = sim.copy()
    copied.set_efforts([9.0])
    assert copied.efforts.tolist() == [5.0]
    sim.set_live({"parameters.strength": 3.0})
    assert sim.efforts.tolist() == [3.0], "an effort beyond the new limit is clamped"
    sim.restore(before)
    sim.set_efforts({"hip": -9.0})
    assert sim.efforts.tolist() == [-2.0]


FOLLOWING = """
mechanism: following
parameters: {d: 0.1, e: 2*d}
parts: {arm: {mass: 1, center: [0, 0, -1]}}
joints: {hip: {type: revolute, between: [ground, arm], axis: [0, 1, 0], position: 1, damping: e, stiffness: 3}}
"""
DAMPING = "joints.hip.damping"


def test_a_live_value_follows_its_formula_until_it_is_given_itself():
    sim = Simulation.from_text(FOLLOWING, live=["parameters.*", "joints.*.damping"])
    sim.set_live({"parameters.d": 0.5})
    assert sim.live == {"parameters.d": 0.5, "parameters.e": 1.0, DAMPING: 1.0}
    built = Simulation.from_text(FOLLOWING, set={"d": 0.5})
    sim.step(200)
    built.step(200)
    assert sim.q == pytest.approx(built.q, abs=1e-13)
    sim.set_live({DAMPING: 0.3})
    sim.set_live({"parameters.d": 0.7})
    assert sim.live == {"parameters.d": 0.7, "parameters.e": 1.4, DAMPING: 0.3}
    sim.set_live({"parameters.e": 2.0})
    sim.set_live({"parameters.d": 0.8})
    assert sim.live == {"parameters.d": 0.8, "parameters.e": 2.0, DAMPING: 0.3}


def test_values_given_together_stay_as_given_and_those_that_are_repeated_follow():
    sim = Simulation.from_text(FOLLOWING, live=["parameters.*", "joints.*.damping"])
    sim.set_live({"parameters.d": 0.1, "parameters.e": 0.2, DAMPING: 0.2})  # as they are
    sim.set_live({"parameters.d": 0.5})
    assert sim.live[DAMPING] == 1.0
    sim.set_live({"parameters.d": 0.6, DAMPING: 1.0})
    assert sim.live == {"parameters.d": 0.6, "parameters.e": 1.2, DAMPING: 1.0}


def test_what_follows_what_is_found_again_from_a_snapshot():
    sim = Simulation.from_text(FOLLOWING, live=["parameters.*", "joints.*.damping"])
    sim.set_live({"parameters.d": 0.5})
    following = sim.snapshot()
    sim.set_live({DAMPING: 0.3})
    for snapshot, expected in ((following, 1.4), (sim.snapshot(), 0.3)):
        other = Simulation.from_text(FOLLOWING, live=["parameters.*", "joints.*.damping"])
        other.restore(snapshot)
        other.set_live({"parameters.d": 0.7})
        assert other.live == {"parameters.d": 0.7, "parameters.e": 1.4, DAMPING: expected}


def test_values_that_follow_a_parameter_are_found_at_once(monkeypatch):
    names = [f"parts.arm.inertia[{axis}]" for axis in range(3)] + [f"parts.arm.center[{axis}]" for axis in range(3)]
    text = FOLLOWING.replace("[0, 0, -1]}", "[d, d, 10*d], inertia: [10*d, 20*d, 15*d]}")
    live, built = ["parameters.d", *names, DAMPING], []
    sim = Simulation.from_text(text, live=live)
    sim.set_live({"parameters.d": 0.2, DAMPING: 0.7})
    assert list(sim.live.values()) == [0.2, 2.0, 4.0, 3.0, 0.2, 0.2, 2.0, 0.7]
    other = LiveValues(parse_mechanism(text), live)
    monkeypatch.setattr(live_values, "with_values", lambda *given: built.append(given) or with_values(*given))
    assert other.given_among(sim.live) == {"parameters.d": 0.2, DAMPING: 0.7}
    assert len(built) == 1


def test_given_values_are_found_again_with_one_validation(monkeypatch):
    text = FOLLOWING.replace("[0, 0, -1]}", "[0, 0, -1], inertia: [0.5, 0.6, 0.7]}")
    live = ["gravity[*]", "parts.*", "joints.*", "parameters.*"]
    sim = Simulation.from_text(text, live=live)
    keys = [key for key, value in sim.live.items() if key != "parameters.e" and value]
    given = {key: (1.1 + 0.01 * index) * sim.live[key] for index, key in enumerate(keys)}
    sim.set_live(given)
    other, built = LiveValues(parse_mechanism(text), live), []
    monkeypatch.setattr(live_values, "with_values", lambda *args: built.append(args) or with_values(*args))
    assert other.given_among(sim.live) == given
    assert len(built) == 1 < len(given)


def test_a_value_given_as_in_the_file_stays_after_a_restore_though_its_formula_has_changed():
    live = ["parameters.*", DAMPING]
    sim = Simulation.from_text(FOLLOWING, live=live)
    sim.set_live({"parameters.d": 0.5, "parameters.e": 0.2})
    sim.set_live({DAMPING: 0.3})
    sim.set_live({DAMPING: 0.2})
    other = Simulation.from_text(FOLLOWING, live=live)
    other.restore(sim.snapshot())
    other.set_live({"parameters.d": 0.6})
    assert other.live == {"parameters.d": 0.6, "parameters.e": 0.2, DAMPING: 0.2}


UNDEFINED = """
mechanism: undefined
parameters: {l: 1, d: 1/(l - 1.5) + 3}
parts: {mass: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], stiffness: l, damping: d}}
"""


def test_a_given_value_stays_after_a_restore_at_which_its_formula_is_not_defined():
    sim = Simulation.from_text(UNDEFINED, live=["l", "d"])
    sim.set_live({"d": 2.0})
    sim.set_live({"l": 1.5})
    other = Simulation.from_text(UNDEFINED, live=["l", "d"])
    other.restore(sim.snapshot())
    other.set_live({"l": 1.6})
    assert other.live == {"l": 1.6, "d": 2.0}


INERTIA = FOLLOWING.replace("[0, 0, -1]}", "[0, 0, 0], inertia: [1, 1, d + 0.9]}")


def test_values_that_are_possible_only_together_are_found_again_and_repeated():
    """Without one of them, the inertia would violate the triangle inequality."""
    names = [f"parts.arm.inertia[{axis}]" for axis in range(3)]
    sim = Simulation.from_text(INERTIA, live=["parameters.*", *names])
    sim.set_live(dict.fromkeys(names, 0.1))
    other = Simulation.from_text(INERTIA, live=["parameters.*", *names])
    other.restore(sim.snapshot())
    other.set_live({"parameters.e": 0.7})
    assert other.live == {"parameters.d": 0.1, "parameters.e": 0.7, **dict.fromkeys(names, 0.1)}
    another = Simulation.from_text(INERTIA, live=["parameters.*", *names])
    another.set_live({"parameters.d": 5.0, names[2]: 1.0})
    assert another.live == {"parameters.d": 5.0, "parameters.e": 10.0, **dict.fromkeys(names, 1.0)}


def test_a_single_name_may_be_given_by_itself():
    sim = Simulation.from_text(FOLLOWING, live="parameters.d", wrenches="arm")
    assert list(sim.live) == ["parameters.d"]
    sim.set_wrench("arm", force=(1.0, 0.0, 0.0))
