"""Efforts and reactions by inverse dynamics against those of a simulation whose joint is driven."""

import numpy as np
import pytest

from mbd_sim import MechanismError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.studies.kinematic_analysis import drive_loads, driven_motion
from test.studies.kinematic_analysis.linkages import four_bar

TURN = 2.0 * np.pi
SPEED = 8.0


def test_loads_are_those_of_a_driven_simulation():
    mechanism = four_bar()
    motion = driven_motion(mechanism, {"motor": (1.0, 1.0 + TURN)}, 25, speed=SPEED)
    loads = drive_loads(motion)
    driven = Simulation(parse_mechanism(mechanism.source.text.replace("position: 60 deg}", f"drive: 1 + {SPEED}*t}}")))
    at, peak = np.empty(driven.model.layout.nq), np.max(np.abs(loads.reactions["pin"].force))
    for row, time in enumerate(motion.time.tolist()):
        at[:] = motion.q[row, 1:]
        y = np.concatenate([at, motion.u[row, 1:], np.zeros(len(driven.y) - 2 * len(at))])
        _, _, (force,) = driven.model.drives(time, y, driven.model.inputs)
        assert force == pytest.approx(loads.efforts["motor"][row], abs=1e-9)
        for name, reaction in driven.model.reactions(time, y, driven.model.inputs).items():
            assert reaction.force == pytest.approx(loads.reactions[name].force[row], abs=1e-12 * peak)
            assert reaction.moment == pytest.approx(loads.reactions[name].moment[row], abs=1e-12 * peak)
    assert np.max(np.abs(loads.power - SPEED * loads.efforts["motor"])) < 1e-12


def test_at_rest_the_drive_holds_the_weight():
    """By virtual work: the torque is the slope of the potential energy."""
    mechanism = load_mechanism("slider_crank")
    motion = driven_motion(mechanism, {"pivot": (0.3, 2.8)}, 6, speed=0.0)
    loads = drive_loads(motion)

    def potential(angle):
        return 9.81 * 0.2 * np.sin(angle) * (2.0 / 2 + 1.5 / 2)

    slope = (potential(motion.drive + 1e-4) - potential(motion.drive - 1e-4)) / 2e-4
    assert loads.efforts["pivot"] == pytest.approx(slope, abs=1e-7)
    assert not motion.u.any() and not motion.u_rates.any()


def test_mechanisms_with_stops_are_refused():
    mechanism = load_mechanism("slider_crank_friction")
    motion = driven_motion(mechanism, {mechanism.coordinate_names[0]: (0.1, 0.2)}, 2)
    with pytest.raises(MechanismError, match="has no loads that follow from its motion, because it has one-sided"):
        drive_loads(motion)
