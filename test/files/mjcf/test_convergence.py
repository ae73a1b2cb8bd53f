"""MuJoCo's contacts with steps towards zero: when they converge to rigid contact, and that ours is their limit."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.on_floor import on_floor
from test.files.mjcf.test_contacts import dog
from test.oracles.mujoco_oracle import import_mujoco

RECOVERY = 0.02  # s
MU, G = 0.5, 9.81
PARTICLE = f"""<mujoco><worldbody><geom type="plane" size="0 0 1" friction="{MU}"/>
<body name="ball" pos="0 0 0.1"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
<geom size="0.1" mass="1" friction="{MU}"/></body></worldbody></mujoco>"""


def run(text, until, step, start=None, speeds=None, solref=None):
    """MuJoCo's data at the time `until`, with elliptic cones."""
    mujoco = import_mujoco()
    spec = mujoco.MjSpec.from_string(text)
    spec.option.timestep, spec.option.cone = step, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance = 1e-14
    for geom in spec.geoms:
        geom.solref = solref or [-1.0 / (RECOVERY * step), -1.0 / step]
        geom.solimp = [0.9999, 0.9999, 1e-3, 0.5, 2.0]
    model = spec.compile()
    data = mujoco.MjData(model)
    for array, values in ((data.qpos, start), (data.qvel, speeds)):
        if values is not None:
            array[:] = values
    mujoco.mj_step(model, data, round(until / step))
    return data


def order(errors, ratio):
    """The exponent with which errors fall at steps that fall by a ratio."""
    return np.log(errors[0] / errors[-1]) / ((len(errors) - 1) * np.log(ratio))


@pytest.mark.parametrize("step", [1e-3, 1e-5])
def test_a_time_constant_of_two_steps_rebounds_at_any_step(step):
    """Of a speed of 1 m/s, the next step leaves k r h = depth/4h: what is documented of solref, and how it is mended."""
    for part in (0.2, 0.8):
        start = [0.0, (1.0 - part) * step], [0.0, -1.0]
        usual = run(PARTICLE, 2.0 * step, step, *start, solref=[2.0 * step, 1.0])
        assert usual.qvel[1] == pytest.approx(0.25 * part, abs=2.0 * G * step + 1e-4)
        recovering = run(PARTICLE, 2.0 * step, step, *start)
        assert recovering.qvel[1] == pytest.approx(part * step / RECOVERY, abs=2.0 * G * step + 1e-4)


def test_a_particle_that_lands_and_slides_comes_to_rest_where_coulomb_says():
    """It loses μ times its normal speed at landing, but not more than it has, and then μ g."""
    speed, normal = 2.0, np.sqrt(2.0 * G * 0.1)
    left = max(0.0, speed - MU * normal)
    expected = speed * normal / G + left**2 / (2.0 * MU * G)
    errors = [abs(run(PARTICLE, 1.0, h, [0.0, 0.1], [speed, 0.0]).qpos[0] - expected) for h in (1e-3, 2.5e-4, 6.25e-5)]
    assert errors[-1] < speed * 6.25e-5 and errors[0] < 2.0 * speed * 1e-3
    mechanism = with_values(on_floor(parse_mechanism(PARTICLE)), {"joints.z.position": 0.1, "joints.x.velocity": speed})
    simulation = Simulation(mechanism)
    simulation.run(until=1.0)
    assert simulation.q[0] == pytest.approx(expected, abs=1e-10)


def test_a_tripod_lands_where_mujoco_converges_to():
    """Differences fall in proportion to the step, just after landing and later."""
    mechanism = with_values(on_floor(parse_mechanism(dog())), {"joints.base.position": [0.0, 0.0, 0.42]})
    simulation = Simulation(mechanism, method="tsitouras8")
    start = simulation.q.copy()
    for until, largest in ((0.15, 2e-3), (0.2, 2e-4)):
        simulation.run(until=until)
        errors = [np.max(np.abs(run(dog(), until, h, start).qpos - simulation.q)) for h in (1e-3, 2e-4, 4e-5)]
        assert errors[0] < largest and order(errors, 5.0) > 0.8
