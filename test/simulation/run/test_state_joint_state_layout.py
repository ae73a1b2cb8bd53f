"""The arrays of joint states, and the state that they describe."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.simulation.run.state import integrated_energies, joint_state_arrays, joint_state_names, recorded_state


@pytest.mark.parametrize("mechanism", ["double_rod", "spherical_top", "tumbling", "moving_support_pendulum"])
def test_the_state_is_recovered_from_its_joint_states(mechanism):
    simulation = Simulation.from_file(mechanism)
    start = simulation.state
    simulation.step(50)
    model = simulation.model
    position, velocity, effort = joint_state_arrays(model, simulation.time, simulation.y, simulation.inputs)
    assert len(position) == len(velocity) == len(effort) == len(joint_state_names(model))
    state = recorded_state(model, start, position, velocity)
    state[-3:] = integrated_energies(simulation.energies)
    poses = (model.pose_array(simulation.time, y, simulation.inputs) for y in (state, simulation.y))
    np.testing.assert_allclose(*poses, rtol=0.0, atol=1e-13)  # a quaternion and its negative are the same orientation
    np.testing.assert_array_equal(state[model.u_range], simulation.u)
    np.testing.assert_array_equal(state[-3:], simulation.y[-3:])
    assert np.any(state != start)


def test_driven_coordinates_come_last_with_the_forces_of_their_drives():
    simulation = Simulation.from_file("moving_support_pendulum")
    simulation.step(50)
    model = simulation.model
    names = joint_state_names(model)
    arrays = joint_state_arrays(model, simulation.time, simulation.y, simulation.inputs)
    drives = simulation.drives()
    assert names[-len(drives) :] == tuple(drives)
    for index, name in enumerate(names[-len(drives) :], len(names) - len(drives)):
        assert tuple(values[index] for values in arrays) == tuple(drives[name])
