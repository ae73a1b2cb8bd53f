"""Which of several events within one step is the first one."""

import pytest

from mbd_sim import Simulation

MEETS, PARTS, STRIKES = 0.0003, 0.0016, 0.001  # s, within a step of 2 ms
RISE = 1e-3  # m/s
TWO = f"""
mechanism: two
integrator: {{step: 2 ms, method: tsitouras8}}
gravity: [0, 0, 0]
parts:
  base: {{shape: {{type: block, size: [3, 1, 1], at: [0, 0, -0.5], mass: 1}}}}
  back: {{shape: {{type: sphere, radius: 0.1, mass: 1}}}}
  fast: {{shape: {{type: sphere, radius: 0.1, mass: 1}}}}
joints:
  base: {{type: fixed, between: [ground, base]}}
  back: {{type: prismatic, between: [ground, back], axis: [0, 0, 1], position: 0.1, velocity: {RISE}}}
  fast: {{type: prismatic, between: [ground.aside, fast], axis: [0, 0, 1], position: {0.1 + STRIKES}, velocity: -1}}
ground: {{points: {{aside: [1, 0, 0]}}}}
forces: {{curve: {{type: effort, coordinate: back, effort: "{RISE / (MEETS * PARTS)}*(6*t - {2 * (MEETS + PARTS)})"}}}}
contacts:
  one: {{between: [ONE, base], restitution: 0.5}}
  other: {{between: [OTHER, base], restitution: 0.5}}
"""


@pytest.mark.parametrize("order", [("back", "fast"), ("fast", "back")])
def test_bodies_that_meet_before_others_and_part_within_the_step_meet_first(order):
    """A body leaves another, comes back to it, and would leave it again: c t (t - 0.3 ms) (t - 1.6 ms).

    Where both ends of the step are free, only the impact of another body in between shows that they have met.
    """
    simulation = Simulation.from_text(TWO.replace("ONE", order[0]).replace("OTHER", order[1]))
    simulation.step(1)
    first = simulation.contact_events[0]
    assert first.time == pytest.approx(MEETS, abs=1e-11)
    assert any(event.time == pytest.approx(STRIKES, abs=1e-11) for event in simulation.contact_events)
