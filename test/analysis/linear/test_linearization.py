"""Small motions against textbook frequencies, and the linearization against differences of the motion itself."""

from unittest.mock import patch

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.analysis.equilibria import equilibrium as equilibrium_module
from mbd_sim.analysis.equilibria.equilibrium import equilibria, equilibrium, is_autonomous
from mbd_sim.analysis.linear.linearization import linearize, modes
from mbd_sim.analysis.linear.small_motion import steadier_before_joints, turning_of_parts
from mbd_sim.analysis.mechanics.inverse_dynamics import inertia_split
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism

G = 9.81


def small_motions(mechanism):
    """The stable equilibrium nearest to the start, and the modes there."""
    equations = derive(mechanism)
    with patch.object(equilibrium_module, "ATTEMPTS", 2):
        q = next(found.q for found in equilibria(equations) if found.stable)
    zeros = np.zeros(equations.layout.nv)
    return q, modes(linearize(equations, q, zeros, zeros))


def test_rod_pendulum():
    """ω² = 3 g / 2 l."""
    q, (mode,) = small_motions(load_mechanism("rod_pendulum"))
    assert q == pytest.approx([0.0], abs=1e-9)
    assert mode.frequency == pytest.approx(np.sqrt(1.5 * G) / (2 * np.pi), rel=1e-12)
    assert mode.damping == 0.0


def test_double_rod():
    """ω² g/l: 3 ± 6/√7 … from det(K - ω² M) = 0 of two equal rods."""
    mass = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]])
    stiffness = G * np.diag([3 / 2, 1 / 2])
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness))) / (2 * np.pi)
    _, found = small_motions(load_mechanism("double_rod"))
    assert [mode.frequency for mode in found] == pytest.approx(sorted(exact), rel=1e-12)


def test_a_bead_in_a_spun_tube_rests_where_gravity_and_rotation_balance():
    """cos θ = g / r Ω², and ω = Ω sin θ (Huston & Liu, sec. 8.5)."""
    mechanism = load_mechanism("spun_tube_particle")
    p = mechanism.parameters
    angle = np.arccos(G / (p["r"] * p["omega"] ** 2))
    q, (mode,) = small_motions(mechanism)
    assert abs(q[0]) == pytest.approx(angle, rel=1e-9)
    assert mode.frequency == pytest.approx(p["omega"] * np.sin(angle) / (2 * np.pi), rel=1e-9)


DAMPED = """
mechanism: damped
parts: {mass: {mass: 2}}
joints: {rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], stiffness: 50, damping: DAMPING}}
"""


def test_an_equilibrium_is_found_a_hundred_meters_from_the_start():
    """A weight on a soft spring, at -m g/k."""
    mechanism = parse_mechanism("""
mechanism: soft
parts: {weight: {mass: 10}}
joints: {rail: {type: prismatic, between: [ground, weight], axis: [0, 0, 1], stiffness: 1}}
""")
    q, (mode,) = small_motions(mechanism)
    assert q == pytest.approx([-10.0 * G], rel=1e-12)
    assert mode.frequency == pytest.approx(np.sqrt(0.1) / (2 * np.pi), rel=1e-12)


def test_an_acceleration_that_vanishes_at_infinity_has_no_equilibrium():
    mechanism = parse_mechanism("""
mechanism: vanishing
gravity: [0, 0, 0]
parts: {mass: {mass: 1}}
joints: {x: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], position: 1}}
forces: {field: {type: effort, coordinate: x, effort: "-3.986e14/(6.4e6 + x)**2"}}
""")
    with patch.object(equilibrium_module, "ATTEMPTS", 3):
        assert equilibrium(derive(mechanism)) is None


def test_slow_modes_are_not_taken_for_zeros():
    """A flywheel slows down with d/I = 1e-5 1/s; a second one turns freely, and has two eigenvalues of zero."""
    simulation = Simulation.from_text("""
mechanism: flywheels
gravity: [0, 0, 0]
parts: {one: {mass: 1, inertia: [1, 1, 2]}, other: {mass: 1, inertia: [1, 1, 2]}}
joints:
  one: {type: revolute, between: [ground, one], axis: [0, 0, 1], damping: 2e-5}
  other: {type: revolute, between: [ground, other], axis: [0, 0, 1]}
""")
    *zeros, slow = modes(simulation.linearize())
    assert [mode.eigenvalue for mode in zeros] == [0.0, 0.0, 0.0]
    assert slow.eigenvalue == pytest.approx(-1e-5, rel=1e-12)
    assert slow.damping == 1.0


@pytest.mark.parametrize(("radius", "angle"), [(0.1, 0.3), (0.01, 1.1), (0.001, 2.0), (0.001, 0.3)])
def test_a_balanced_wheel_turns_freely_however_small(radius, angle):
    """Two masses at opposite ends of a lever, m r = M R; round-off leaves a moment of their weights."""
    wheel = Simulation.from_text(f"""
mechanism: balanced
parts:
  wheel:
    shapes:
      - {{type: particle, radius: {radius / 50}, mass: 0.7, at: [{radius * 1.1}, 0, {radius * 0.7}]}}
      - {{type: particle, radius: {radius / 50}, mass: 0.3, at: [{-radius * 7.7 / 3}, 0, {-radius * 4.9 / 3}]}}
joints: {{hub: {{type: revolute, between: [ground, wheel], axis: [0, -1, 0], position: {angle}}}}}
""")
    assert {mode.eigenvalue for mode in modes(wheel.linearize())} == {0.0}


def test_damping_ratio():
    damping = 3.0
    _, (mode,) = small_motions(parse_mechanism(DAMPED.replace("DAMPING", str(damping))))
    assert mode.frequency == pytest.approx(5.0 / (2 * np.pi), rel=1e-12)
    assert mode.damping == pytest.approx(damping / (2 * np.sqrt(50 * 2)), abs=1e-12)


def test_beyond_critical_damping_nothing_oscillates():
    _, found = small_motions(parse_mechanism(DAMPED.replace("DAMPING", "30")))
    roots = np.sort(np.abs(np.roots([2, 30, 50])))
    assert [mode.frequency for mode in found] == [0.0, 0.0]
    assert [-mode.eigenvalue.real for mode in found] == pytest.approx(roots, rel=1e-10)


def test_a_closed_loop_hangs_and_swings():
    """A02 with N = 2 hangs as a pendulum of one degree: ω² = ((N+1)/2 + N) g / ((N+1)/3 + N)."""
    equations = derive(load_mechanism("a02_four_bars"))
    hanging = np.pi * np.array([1.0, 1.0, 1.0, -1.0, -1.0])
    (mode,) = modes(linearize(equations, hanging, np.zeros(5), np.zeros(5)))
    assert mode.frequency == pytest.approx(np.sqrt(3.5 * G / 3.0) / (2 * np.pi), rel=1e-9)


@pytest.mark.parametrize("name", ["four_bar", "spherical_top", "rolling_disc"])
def test_the_linearization_is_the_derivative_of_the_motion(name):
    """About a moving state: how displaced states move on, projected onto the free directions."""
    simulation = Simulation.from_file(name, step=1e-3)
    simulation.run(0.2)
    equations, nv = simulation.model.equations, simulation.model.layout.nv
    constraints, q, u = equations.constraints, simulation.q.copy(), simulation.u.copy()
    efforts = np.zeros(nv)
    linear = linearize(equations, q, u, efforts)
    h = 1e-6
    k, turning = linear.displacements.shape[1], turning_of_parts(equations, u)
    moving = np.concatenate([q, u, np.zeros(3)])
    if not turning.any() or not steadier_before_joints(equations, 0.0, moving, efforts, turning):
        turning = np.zeros((nv, nv))

    def speeds_rate(displacement, change):
        moved = constraints.displaced(q, linear.displacements @ displacement)
        gradient, drift = constraints.gradient(0.0, moved), constraints.drift(0.0, moved)
        speeds = u + linear.speeds @ change
        if len(gradient):
            speeds = speeds - np.linalg.pinv(gradient) @ (gradient @ speeds + drift)
        y = np.concatenate([moved, speeds, np.zeros(3)])
        rates = np.array(equations.rates.call([0.0, y, efforts])[0]).ravel()
        return np.linalg.pinv(linear.speeds) @ (rates[len(q) : len(q) + nv] + turning @ (speeds - u))

    size = max(np.max(np.abs(linear.a)), 1.0)
    for column in range(linear.a.shape[1]):
        step = np.zeros(linear.a.shape[1])
        step[column] = h
        ahead, behind = (speeds_rate(sign * step[:k], sign * step[k:]) for sign in (1.0, -1.0))
        assert linear.a[k:, column] == pytest.approx((ahead - behind) / (2 * h), abs=1e-6 * size)


def test_what_depends_on_time_is_not_linearized():
    assert is_autonomous(derive(load_mechanism("spun_tube_particle")))
    assert not is_autonomous(derive(load_mechanism("moving_support_pendulum")))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("four_bar", {"gravity[2]": -3.0, "parameters.density": 2.0}),
    ],
)
def test_live_values_count_as_those_of_the_file(name, changes):
    mechanism = load_mechanism(name)
    live, built = Simulation(mechanism, live=list(changes)), Simulation(with_values(mechanism, changes))
    for sim in (live, built):
        sim.set_efforts([0.3] * len(sim.u))
    live.set_live(changes)
    live.step(200)
    built.restore(live.state, live.steps)
    one, other = live.linearize(), built.linearize()
    assert one.a == pytest.approx(other.a, rel=1e-9, abs=1e-9) and one.b == pytest.approx(other.b, rel=1e-9)


def test_a_wrench_is_part_of_the_linearization():
    """A rod in the weight of its own and a force F at the tip along gravity: ω² = (m g / 2 + F) / (m l / 3)."""
    sim = Simulation.from_file("rod_pendulum", wrenches=["rod"])
    m, length = (sim.mechanism.parameters[name] for name in ("m", "l"))
    sim.reset(q=[0.0], u=[0.0])
    sim.set_wrench("rod", force=[0.0, 0.0, -5.0], at=[0.0, 0.0, -length])
    (mode,) = modes(sim.linearize())
    assert 2 * np.pi * mode.frequency == pytest.approx(np.sqrt((m * G / 2 + 5.0) / (m * length / 3)), rel=1e-12)


SPUN_TOP = """
mechanism: top
parts: {top: {mass: 2, center: [0, 0, 0.3], inertia: {xx: 0.05, yy: 0.05, zz: 0.04}}}
joints: {pivot: {type: spherical, between: [ground, top], angular_velocity: [0, 0, 40]}}
"""


def test_a_sleeping_top_in_axes_that_turn_with_it():
    """I λ² - i C Ω λ - m g h = 0 for a tilt in fixed axes (Lagrange's top); in the part's own, λ is less by i Ω."""
    sim = Simulation.from_text(SPUN_TOP)
    inertia, spin = 0.05 + 2 * 0.3**2, 40.0
    fixed = np.roots([inertia, -1j * 0.04 * spin, -2 * G * 0.3])
    exact = [sign(value - 1j * spin) for value in fixed for sign in (np.conj, np.positive)]
    found = [value for value in np.linalg.eigvals(sim.linearize().a) if abs(value) > 1.0]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(exact), rel=1e-12)


def test_compiled_derivatives_and_reactions_are_those_of_the_equations():
    sim = Simulation.from_file("four_bar")
    sim.run(0.2)
    equations = sim.model.equations
    one, other = sim.linearize(), linearize(equations, sim.q, sim.u, sim.efforts, sim.time)
    assert one.a == pytest.approx(other.a, rel=1e-12, abs=1e-11) and one.b == pytest.approx(other.b, rel=1e-12)
    expected = sim.model.reactions(sim.time, sim.y, sim.inputs)
    assert list(sim.reactions()) == list(expected)
    for joint, reaction in sim.reactions().items():
        assert reaction.force == pytest.approx(expected[joint].force, rel=1e-12, abs=1e-11)
        assert reaction.moment == pytest.approx(expected[joint].moment, rel=1e-12, abs=1e-11)


@pytest.mark.parametrize("speed", [0.0, 0.5, 3.0])
def test_a_disc_that_rolls_straight_on_is_stable_if_it_is_fast(speed):
    """λ² = 4 g/5 r - 12 ω²/5: from ω² = g/3 r on it oscillates. Place, heading and spin are neutral."""
    sim = Simulation.from_file("rolling_disc")
    r = sim.mechanism.parameters["r"]
    sim.reset(q=[0, 0, r, 1, 0, 0, 0], u=[speed, 0, 0, 0, speed / r, 0])
    exact = np.sqrt(0.8 * G / r - 2.4 * (speed / r) ** 2 + 0j)
    found = np.linalg.eigvals(sim.linearize().a)
    found = found[np.argsort(np.abs(found))]
    assert np.abs(found[:6]) == pytest.approx(np.zeros(6), abs=1e-4)
    assert np.sort_complex(np.round(found[6:], 12)) == pytest.approx(np.sort_complex([exact, -exact]), rel=1e-9)


def test_what_is_no_linearization_or_no_equations_is_refused_with_the_way_to_it():
    sim = Simulation.from_file("rod_pendulum")
    with pytest.raises(TypeError, match=r"is not a Linearization\. Give simulation\.linearize\(\)"):
        modes(sim)
    for analyze in (equilibrium, inertia_split, lambda given: linearize(given, [0.0], [0.0], [0.0])):
        with pytest.raises(TypeError, match=r"is not Equations\. .*simulation\.model\.equations"):
            analyze(sim)
    with pytest.raises(ValueError, match=r"q must be a list of 1 value, not an array of shape \(2,\)"):
        linearize(sim.model.equations, [0.0, 0.0], [0.0], [0.0])
    given = sim.model.equations, sim.q, sim.u, sim.efforts
    with pytest.raises(ValueError, match=r"inputs must be a list of"):
        linearize(*given, inputs=[0.0] * 99)
    with pytest.raises(ValueError, match=r"states must be a list of"):
        linearize(*given, states=0.0)


def test_inputs_that_are_not_finite_are_refused():
    equations = Simulation.from_file("four_bar", live="gravity[2]").model.equations
    given = equations.start.q, equations.start.u, np.zeros(equations.layout.nv)
    inputs = equations.inputs_without_commands.copy()
    inputs[equations.inputs.values] = np.nan
    with pytest.raises(ValueError, match="inputs contains a value that is not finite"):
        linearize(equations, *given, inputs=inputs)
