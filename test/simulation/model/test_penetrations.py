"""Live values that would put parts inside each other, or coordinates beyond bounds, are refused.

The next step moved the parts out of each other instead, by whatever that takes, with the energy account open.
"""

import math

import numpy as np
import pytest

from mbd_sim import CommandError, Simulation

TEXT = """
mechanism: bounds
parameters: {stop: 1, rope: 1, play: 0.2, r: 0.1, floor: -2, shelf: 0}
ground: {points: {hook: [0, 3, 0], floor: [0, 0, floor]}}
parts:
  a: {mass: 1}
  b: {mass: 1}
  bob: {mass: 1, inertia: [0.1, 0.1, 0.1]}
  ball: {mass: 1, inertia: [0.1, 0.1, 0.1], collisions: [{type: sphere, radius: r}]}
  shelf: {shape: {type: block, size: [1, 1, 0.1], mass: 1}}
  box: {shape: {type: block, size: [0.1, 0.1, 0.1], mass: 1}}
joints:
  a: {type: prismatic, between: [ground, a], axis: [1, 0, 0], velocity: 2,
      limits: {lower: -1, upper: stop, restitution: 0.2}}
  b: {type: prismatic, between: [ground, b], axis: [1, 0, 0], velocity: 0.5}
  bob: {type: free, between: [ground.hook, bob], position: [0, 0, -1]}
  ball: {type: free, between: [ground, ball], position: [5, 0, -1.85]}
  shelf: {type: prismatic, between: [ground.base, shelf], axis: [0, 0, 1], stiffness: 1e4}
  box: {type: free, between: [ground, box], position: [8, 0, 0.14]}
constraints:
  rope: {type: distance, between: [ground.hook, bob], length: rope, bound: at_most}
  gear: {type: coupling, terms: {a: 1, b: -1}, backlash: play}
contacts:
  floor: {parts: [ball], plane: ground.floor, restitution: 0.3}
  shelf: {between: [box, shelf], friction: 0.5}
""".replace("floor: [0, 0, floor]", "floor: [0, 0, floor], base: [8, 0, shelf]")
VALUES = {"stop": 1.0, "rope": 1.0, "play": 0.2, "r": 0.1, "floor": -2.0, "shelf": 0.0}
SLOPES = {"stop": 1.0, "rope": 1.0, "play": 0.5, "r": -1.0, "floor": -1.0, "shelf": -1.0}  # of the room


@pytest.fixture(scope="module")
def simulation():
    return Simulation.from_text(TEXT, live=list(VALUES))


def room(simulation, name):
    """By how much the bodies are apart, from the state and the file, in m."""
    live = simulation.live
    at = dict(zip(simulation.coordinate_names, simulation.model.coordinates(simulation.y).tolist(), strict=True))
    on_floor = at["ball.z"] - live["r"] - live["floor"]
    return {
        "stop": live["stop"] - at["a"],
        "rope": live["rope"] - math.hypot(at["bob.x"], at["bob.y"], at["bob.z"]),
        "play": live["play"] / 2.0 - abs(at["a"] - at["b"]),
        "r": on_floor,
        "floor": on_floor,
        "shelf": at["box.z"] - at["shelf"] - live["shelf"] - 0.1,
    }[name]


@pytest.mark.parametrize("name", VALUES)
def test_a_live_value_is_taken_where_bodies_stay_apart_and_else_changes_nothing(simulation, name):
    random = np.random.default_rng(len(name))
    simulation.reset()
    simulation.set_live(VALUES)
    simulation.run(until=0.35)
    start, old, space = simulation.snapshot(), simulation.live[name], room(simulation, name)
    for wanted in (-0.001, 0.001, *random.uniform(-0.04, 0.04, 4)):
        simulation.restore(start)
        value = old + (wanted - space) / SLOPES[name]
        if wanted > 0.0:
            simulation.set_live({name: value})
            assert simulation.live[name] == value
        else:
            y, inputs = simulation.y.copy(), np.array(simulation.inputs)
            with pytest.raises(CommandError, match=rf"{name}: with this, .* move the mechanism first"):
                simulation.set_live({name: value})
            assert simulation.live[name] == old
            assert np.array_equal(simulation.y, y)
            assert np.array_equal(simulation.inputs, inputs)
        simulation.step(20)
        assert abs(simulation.energies.residual) < 1e-9
