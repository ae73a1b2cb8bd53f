"""Hydraulic and pneumatic cylinders: textbook equations integrated independently, closed forms, and their accounts."""

import math

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.recordings.run.verification import verify

MASS, AREAS, DEAD = 100.0, (12e-4, 8e-4), (5e-5, 6e-5)
STROKE, START, FRICTION = 0.5, 0.2, 300.0
BETA, SUPPLY, TANK, LEAK, TRANSITION = 1.4e9, 150e5, 2e5, 2e-12, 1e5
FLOW = 40e-3 / 60
SLIDE = f"""
mechanism: press
gravity: [-5, 0, 0]
parts: {{m: {{mass: {MASS} kg}}}}
joints: {{s: {{type: prismatic, between: [ground, m], axis: [1, 0, 0], position: {START} m, damping: {FRICTION}}}}}
integrator: {{step: 0.1 ms}}
actuators:
  lift:
    joint: s
    areas: [12 cm^2, 8 cm^2]
    stroke: {STROKE} m
    dead_volumes: [50 cm^3, 60 cm^3]
"""
OIL = """    type: hydraulic_cylinder
    rated_flow: 40 L/min
    supply: 150 bar
    tank: 2 bar
    leakage: 2e-12
    pressures: [30 bar, 38 bar]
"""
CONDUCTANCE, RATIO, EXPONENT, GAS_SUPPLY, AIR = 2e-8, 0.3, 1.2, 7e5, 101325.0
GAS = f"""    type: pneumatic_cylinder
    conductance: 2e-8
    leakage: 1e-10
    supply: 7 bar
    exponent: {EXPONENT}
    pressures: [2 bar, 3 bar]
"""


def cylinder(fluid, *lines, **options):
    return Simulation.from_text(SLIDE + fluid + "".join(f"    {line}\n" for line in lines), **options)


def root(drop, transition):
    return drop / (drop * drop + transition**2) ** 0.25


def textbook(opening, gas):
    """The rates of position, speed and pressures (Merritt; Jelali & Kroll; ISO 6358), written without the package."""

    def orifice(source, end):
        if not gas:
            return FLOW / math.sqrt(35e5) * root(source - end, TRANSITION)
        high, low = max(source, end), min(source, end)
        share = 1.0 if low / high <= RATIO else math.sqrt(1.0 - ((low / high - RATIO) / (1.0 - RATIO)) ** 2)
        smooth = min(high - low, high * (1.0 - RATIO))
        share *= math.sqrt(smooth / math.hypot(smooth, 1e3))  # the finite slope at zero
        return math.copysign(CONDUCTANCE * 1e5 * high * share, source - end)

    supply, tank = (GAS_SUPPLY, AIR) if gas else (SUPPLY, TANK)
    ends = (supply, tank) if opening > 0.0 else (tank, supply)

    def rates(t, state):
        x, v, pa, pb = state
        volumes = DEAD[0] + AREAS[0] * x, DEAD[1] + AREAS[1] * (STROKE - x)
        qa, qb = abs(opening) * orifice(ends[0], pa), abs(opening) * orifice(ends[1], pb)
        leak = 1e-10 / CONDUCTANCE * orifice(pa, pb) if gas else LEAK * (pa - pb)
        if gas:
            dpa = EXPONENT * (qa - leak - pa * AREAS[0] * v) / volumes[0]
            dpb = EXPONENT * (qb + leak + pb * AREAS[1] * v) / volumes[1]
        else:
            dpa = BETA * (qa - leak - AREAS[0] * v) / volumes[0]
            dpb = BETA * (qb + leak + AREAS[1] * v) / volumes[1]
        outside = AIR if gas else 0.0
        force = (pa - outside) * AREAS[0] - (pb - outside) * AREAS[1]
        return [v, force / MASS - 5.0 - FRICTION * v / MASS, dpa, dpb]

    return rates


@pytest.mark.parametrize(("fluid", "opening"), [(OIL, 0.4), (GAS, -0.3)], ids=["oil", "gas"])
def test_the_motion_and_the_pressures_are_those_of_the_textbook_equations(fluid, opening):
    simulation = cylinder(fluid, f"command: {{opening: {opening}}}", step=2e-5, method="dop853")
    start = [START, 0.0, *([30e5, 38e5] if fluid == OIL else [2e5, 3e5])]
    found = solve_ivp(textbook(opening, fluid == GAS), (0.0, 0.2), start, "DOP853", rtol=3e-14, atol=1e-12)
    simulation.run(until=0.2)
    state = simulation.actuators()["lift"]
    assert abs(simulation.q[0] - START) > 5e-3
    assert (simulation.q[0], simulation.u[0]) == pytest.approx(found.y[:2, -1], rel=1e-9, abs=1e-11)
    assert state.pressures == pytest.approx(found.y[2:, -1], rel=1e-9)


def test_the_natural_frequency_is_that_of_a_mass_between_two_columns_of_oil():
    # Merritt, eq. 6-38: equal areas in the middle of the stroke, with the volume V of both chambers
    text = (SLIDE + OIL).replace("12 cm^2, 8 cm^2", "9 cm^2, 9 cm^2").replace("50 cm^3, 60 cm^3", "55 cm^3, 55 cm^3")
    text = text.replace(f"position: {START}", "position: 0.25").replace(f", damping: {FRICTION}", "")
    text = text.replace("    leakage: 2e-12\n", "")
    matrix = Simulation.from_text(text).linearize().a
    volume = 2 * 55e-6 + 9e-4 * STROKE
    expected = math.sqrt(4.0 * BETA * 9e-4**2 / (volume * MASS))
    assert max(np.linalg.eigvals(matrix).imag) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("fluid", [OIL, GAS, GAS.replace("exponent: 1.2", "exponent: 1")], ids=["oil", "n1.2", "n1"])
def test_the_work_of_the_fluid_is_mechanical_work_losses_and_stored_energy(fluid):
    simulation = cylinder(fluid, "command: {opening: 0.5}", step=5e-5, method="tsitouras8")
    losses = [0.0]
    for opening in (0.5, 0.0, -0.7, 0.2):
        simulation.set_commands({"lift": opening})
        for _ in range(10):
            simulation.run(until=simulation.time + 5e-3)
            account = simulation.actuators()["lift"].energies
            losses.append(account.throttling_loss)
    assert np.all(np.diff(losses) > 0.0)
    assert abs(account.residual) < 1e-9 * account.throttling_loss and abs(account.stored) > 0.1
    assert abs(simulation.energies.residual) < 1e-9 * account.throttling_loss
    net = simulation.energies.work_applied
    assert account.mechanical_work == pytest.approx(net, rel=1e-12)


@pytest.mark.parametrize("fluid", [OIL, GAS, GAS.replace("exponent: 1.2", "exponent: 1")], ids=["oil", "n1.2", "n1"])
def test_the_throttling_loss_is_the_integral_of_its_power(fluid):
    simulation = cylinder(fluid, "command: {opening: 0.5}", step=1e-4, method="tsitouras8")
    simulation.run(until=0.02)
    start = simulation.actuators()["lift"].energies.throttling_loss
    powers = [simulation.actuators()["lift"].throttling_loss]
    for _ in range(100):
        simulation.step()
        powers.append(simulation.actuators()["lift"].throttling_loss)
    lost = simulation.actuators()["lift"].energies.throttling_loss - start
    assert lost == pytest.approx(simpson(powers, dx=1e-4), rel=1e-8)


def test_the_compressed_oil_stores_half_the_volume_times_the_square_of_the_pressure_to_first_order():
    simulation = cylinder(OIL)
    simulation.run(until=0.01)
    state = simulation.actuators()["lift"]
    volumes = DEAD[0] + AREAS[0] * state.position, DEAD[1] + AREAS[1] * (STROKE - state.position)
    start = DEAD[0] + AREAS[0] * START, DEAD[1] + AREAS[1] * (STROKE - START)
    squares = sum(0.5 * v * p**2 / BETA for v, p in zip(volumes, state.pressures, strict=True))
    squares -= sum(0.5 * v * p**2 / BETA for v, p in zip(start, (30e5, 38e5), strict=True))
    assert state.energies.stored == pytest.approx(squares, rel=1e-2)


def test_the_rated_flow_flows_at_the_rated_drop_and_openings_are_limited():
    simulation = cylinder(OIL.replace("30 bar, 38 bar", "115 bar, 37 bar"))
    simulation.set_commands({"lift": 5.0})
    state = simulation.actuators()["lift"]
    assert state.commands == {"opening": 5.0}
    smoothed = 1.0 / (1.0 + (1.0 / 35.0) ** 2) ** 0.25
    assert state.flows == pytest.approx((FLOW * smoothed, -FLOW * smoothed), rel=1e-12)


def test_choked_flow_does_not_depend_on_the_pressure_behind_the_valve():
    flows = []
    for pressure in ("1 bar", "2 bar"):
        simulation = cylinder(GAS.replace("[2 bar,", f"[{pressure},"), "command: {opening: 1}", "transition: 1 Pa")
        flows.append(simulation.actuators()["lift"].flows[0])
    assert flows == pytest.approx([CONDUCTANCE * 1e5 * GAS_SUPPLY] * 2, rel=1e-10)


def test_a_servo_commands_the_valve_and_holds_the_position():
    servo = "servo: {controls: position, kp: 10 m^-1, sample_rate: 1 kHz}"
    simulation = cylinder(OIL, servo, "command: {position: 0.3}", "delay: 1 ms")
    assert simulation.mechanism.actuators[0].servo.limit == 1.0
    simulation.run(until=1.5)
    assert simulation.q[0] == pytest.approx(0.3, abs=1e-3)


def test_a_cylinder_between_two_points_acts_along_their_line():
    text = """
mechanism: boom
parts: {boom: {mass: 50, center: [1, 0, 0], inertia: [1, 20, 20], points: {eye: [0.8, 0, 0]}}}
ground: {points: {foot: [0, 0, -0.6]}}
joints: {hinge: {type: revolute, between: [ground, boom], axis: [0, -1, 0]}}
integrator: {step: 0.1 ms}
actuators:
  lift: {type: hydraulic_cylinder, between: [ground.foot, boom.eye], areas: [12 cm^2, 8 cm^2], stroke: 0.5,
    retracted: 0.8, dead_volumes: [50 cm^3, 60 cm^3], rated_flow: 20 L/min, supply: 150 bar, pressures: [50 bar, 10 bar]}
"""
    simulation = Simulation.from_text(text)
    simulation.set_commands({"lift": 0.5})
    simulation.run(until=0.5)
    state, angle = simulation.actuators()["lift"], simulation.q[0]
    ends = np.array([0.8 * math.cos(angle), 0.0, 0.8 * math.sin(angle)]), np.array([0.0, 0.0, -0.6])
    assert state.position == pytest.approx(np.linalg.norm(ends[0] - ends[1]), rel=1e-13) and state.position > 1.02
    assert abs(simulation.energies.residual) < 1e-9 * state.energies.mechanical_work
    assert abs(state.energies.residual) < 1e-9 * state.energies.fluid_work


def test_a_state_that_is_set_leaves_the_account_closed_and_a_reset_restores_the_pressures():
    simulation = cylinder(OIL, "command: {opening: 0.5}", step=5e-5)
    simulation.run(until=0.05)
    simulation.set_state({"s": 0.4})
    simulation.run(until=0.1)
    account = simulation.actuators()["lift"].energies
    assert abs(account.residual) < 1e-9 * account.throttling_loss
    simulation.reset()
    assert simulation.actuators()["lift"].pressures == (30e5, 38e5)
    assert simulation.actuators()["lift"].energies.stored == 0.0


def test_dimensions_that_change_during_the_run_leave_the_account_closed():
    simulation = cylinder(GAS, "command: {opening: 0.5}", step=5e-5, live=["actuators.lift.areas[0]"])
    simulation.run(until=0.02)
    simulation.set_live({"actuators.lift.areas[0]": 14e-4})
    simulation.run(until=0.04)
    account = simulation.actuators()["lift"].energies
    assert abs(account.residual) < 1e-9 * account.throttling_loss


def test_the_supply_can_be_a_live_value():
    simulation = cylinder(OIL, "command: {opening: 1}", live=["actuators.lift.supply"])
    simulation.set_live({"actuators.lift.supply": 100e5})
    other = cylinder(OIL.replace("150 bar", "100 bar"), "command: {opening: 1}")
    for one in (simulation, other):
        one.run(until=0.02)
    assert simulation.u == pytest.approx(other.u, rel=1e-12)


def test_a_recording_of_a_cylinder_verifies(tmp_path):
    simulation, path = cylinder(OIL, "delay: 2 ms"), tmp_path / "run.mcap"
    simulation.set_commands({"lift": 0.2})
    simulation.run(until=0.01)
    with simulation.recording(path, rate=1000.0):
        simulation.set_commands({"lift": -0.6})
        simulation.run(until=0.03)
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees and verification.commands["applied_commands"] == 1


def test_the_method_is_chosen_by_the_rate_of_an_open_valve():
    assert cylinder(OIL).model.method.name == "adams11"
    slow = cylinder(OIL, step=2e-3)
    assert slow.model.method.name == "rosenbrock" and "s has rates of" in slow.remarks[0]


def test_a_start_beyond_the_stroke_is_refused():
    with pytest.raises(
        MechanismError, match=r"actuators\.lift: starts at 0.2 m, beyond its stroke from 0.25 m to 0.75 m"
    ):
        cylinder(OIL, "retracted: 0.25")
