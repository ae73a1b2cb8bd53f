"""The hydraulic lift and the engine: beside their controllers in another process, and against energy balances."""

import math
import re
import signal
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from mbd_sim import Simulation
from mbd_sim.examples.engine.engine import Dynamometer
from mbd_sim.examples.hydraulic_lift.hydraulic_lift import LevelControl
from mbd_sim.files.load import load_mechanism
from mbd_sim.recordings.run.verification import verify
from test.examples.programs import beside, lockstep
from test.system.growing_recordings import recorded_states
from test.system.nodes import nanoseconds

RECORDED = {"record": True, "record_dir": "logs"}


def verified(folder, mechanism):
    (path,) = (folder / "logs").glob(f"{mechanism}_*.mcap")
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees
    return verification


def test_the_lift_reaches_its_levels_by_commands_of_its_valve_from_another_process(tmp_path):
    options = {**lockstep("hydraulic_scissor_lift", 100), "step_count": 100, **RECORDED}
    with beside(
        tmp_path, options, "hydraulic_lift.hydraulic_lift", "targets:=[0.34, 0.33]", "period:=0.5"
    ) as experiment:
        listener = experiment.listener
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) > 1_000_000_000, "both levels")
        assert experiment.node.end(signal.SIGINT) == 0
    states = recorded_states(tmp_path / "logs")
    hinge = states[5000].names.index("hinge")
    heights = [1.2 * math.sin(states[tick].position[hinge]) for tick in (4900, 9900)]
    assert heights == pytest.approx([0.34, 0.33], abs=2e-3)
    assert verified(tmp_path, "hydraulic_scissor_lift").commands["applied_commands"] > 80


def test_the_level_is_held_although_oil_leaks_and_the_accounts_close():
    sims = [Simulation.from_file("hydraulic_scissor_lift") for _ in range(2)]
    law = LevelControl()
    for sim in sims:
        sim.reset()
    start = 1.2 * math.sin(sims[0].q[sims[0].coordinate_names.index("hinge")])
    heights = []
    for sim, controlled in zip(sims, (True, False), strict=True):
        hinge = sim.coordinate_names.index("hinge")
        for _ in range(300):
            height = 1.2 * math.sin(sim.q[hinge])
            if controlled:
                sim.set_commands({"cylinder": law.opening(sim.time, height, start)})
            sim.step(100)
        heights.append(1.2 * math.sin(sim.q[hinge]))
        account = sim.actuators()["cylinder"].energies
        exchanged = account.throttling_loss + abs(account.mechanical_work)
        assert abs(account.residual) < 1e-9 * exchanged
        assert abs(sim.energies.residual) < 1e-9 * exchanged
    assert heights[0] == pytest.approx(start, abs=2e-3)
    assert heights[1] < start - 0.01


def test_the_engine_is_started_and_braked_by_another_process_as_by_a_script(tmp_path):
    options = {**lockstep("engine", 200), "step_count": 100, **RECORDED}
    with beside(tmp_path, options, "engine.engine", "targets:=[300.0, 220.0]", "period:=1.5") as experiment:
        listener = experiment.listener
        listener.until(lambda: "runs at" in experiment.log.read_text(), "the first speed")
        assert experiment.node.end(signal.SIGINT) == 0
    sim, law, speeds, torques = Simulation.from_file("engine"), Dynamometer(), [], []
    for _ in range(300):
        speeds.append(sim.u[0])
        torques.append(law.torque(sim.time, sim.u[0], 300.0))
        sim.set_commands({"brake": torques[-1]})
        sim.step(100)
    states = recorded_states(tmp_path / "logs")
    mean = np.mean([states[100 * n].velocity[0] for n in range(100, 300)])
    assert mean == pytest.approx(np.mean(speeds[100:]), rel=0.01)
    assert states[100].effort[0] == pytest.approx(0.3)
    assert states[29900].effort[0] == pytest.approx(torques[-1], abs=0.005)
    told = re.search(r"runs at ([0-9.]+) rad/s", experiment.log.read_text())[1]
    assert float(told) == pytest.approx(np.mean(speeds[100:]), rel=0.01)
    verified(tmp_path, "engine")


def test_a_stalled_engine_is_started_again():
    sim, law = Simulation.from_file("engine"), Dynamometer()
    runs = []
    for count in range(1200):
        torque = law.torque(sim.time, sim.u[0], 200.0)
        sim.set_commands({"brake": -0.4 if 400 < count < 420 else torque})
        sim.step(100)
        runs.append(law.runs)
    assert runs[400] and not all(runs[420:500]) and runs[-1]
    assert law.mean == pytest.approx(200.0, rel=0.05)
    assert abs(sim.energies.residual) < 1e-9 * sim.energies.work_applied


def gas_torque(mechanism):
    """The torque of the gas on the crank in N·m by its angle, above 40 rad/s, by SciPy; and dy/dφ of the piston."""
    p, curves = mechanism.parameters, []
    for force in mechanism.applied:
        (curve,) = force.vector[2].tables.values()
        x, f, turn = np.array(curve.x), np.array(curve.values), 4.0 * np.pi
        curves.append(PchipInterpolator([*(x[:-1] - turn), *x, *(x[1:] + turn)], [*f[:-1], *f, *f[1:]]))
    r, length = p["r"], p["l"]

    def slope(angle):
        s, c = math.sin(angle), math.cos(angle)
        return -r * s - r * r * s * c / math.sqrt(length**2 - (r * s) ** 2)

    def torque(angle):
        at = angle % (4.0 * math.pi)
        return -(curves[0](at) + p["throttle"] * curves[1](at)) * slope(angle)

    return torque, slope, sorted({*mechanism.applied[0].vector[2].tables["compression"].x}.union(
        mechanism.applied[1].vector[2].tables["combustion"].x))  # fmt: skip


@pytest.fixture(scope="module")
def cycle():
    """The gas torque, dy/dφ of the piston, and the work of the gas up to some angles of a cycle."""
    torque, slope, knots = gas_torque(load_mechanism("engine"))
    ends = sorted({*knots, *np.linspace(0.0, 4.0 * math.pi, 49)})
    works = np.cumsum([0.0, *(quad(torque, *pair, epsabs=1e-14, epsrel=1e-12)[0] for pair in pairwise(ends))])
    return torque, slope, np.array(ends), works


@pytest.mark.parametrize("flywheel", [1e-4, 4e-4])
def test_the_speed_of_the_crank_follows_from_the_work_of_the_gas(cycle, flywheel):
    """½ (J + m (dy/dφ)²) ω² + m g y is the energy at the start plus the work of the gas and the brake."""
    torque, slope, ends, works = cycle
    load = works[-1] / (4.0 * math.pi)  # the brake takes all of the work of a cycle
    text = load_mechanism("engine").source.text.replace(", damping: 3e-5", "")
    text = text.replace("flywheel: 1e-4", f"flywheel: {flywheel}").replace(
        "position: 200 deg", "position: 0, velocity: 250"
    )
    text = text.replace("position: r*cos(200*pi/180) + sqrt(l**2 - (r*sin(200*pi/180))**2)", "position: r + l")
    sim = Simulation.from_text(text, step=2e-5)
    sim.set_commands({"brake": -load})
    p = sim.mechanism.parameters

    def energy(angle, height, speed):
        inertia = flywheel + p["m_piston"] * slope(angle) ** 2
        return 0.5 * inertia * speed**2 + p["m_piston"] * 9.81 * height

    start, errors, speeds = energy(0.0, sim.q[1], sim.u[0]), [], []
    while sim.q[0] < 4.0 * math.pi:
        sim.step()
        angle = sim.q[0]
        speeds.append(sim.u[0])
        if len(speeds) % 40 == 0 and angle < ends[-1]:
            known = np.searchsorted(ends, angle) - 1
            work = works[known] + quad(torque, ends[known], angle, epsabs=1e-14, epsrel=1e-12)[0]
            errors.append(energy(angle, sim.q[1], sim.u[0]) - start - work + load * angle)
    assert len(errors) > 40 and np.max(np.abs(errors)) < 1e-9 * start
    excess = np.ptp(works - load * ends)
    ripple = np.ptp(speeds) / np.mean(speeds)
    assert ripple == pytest.approx(excess / (flywheel * np.mean(speeds) ** 2), rel=0.1)
