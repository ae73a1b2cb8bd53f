"""A test arm on a servo that samples its position."""

from __future__ import annotations

ARM = """
mechanism: {name}
parts:
  arm: {{mass: 1 kg, inertia: [0.1, 0.1, 0.1], center: [0, 0, -0.2 m]}}
joints:
  pin: {{type: revolute, between: [ground, arm], axis: [0, 1, 0]}}
"""
DRIVE = """
actuators:
  drive:
    type: effort
    joint: pin
    delay: {delay}
    servo: {{controls: position, kp: 3, kd: 0.5, sample_rate: 250 Hz{more}}}
integrator: {{step: 1 ms, method: rk4}}
"""
INTEGRAL = ", ki: 0.2, rate_limit: 2 rad/s"  # of a servo with states of its own


def sampled_drive(*, delay: str = "0 s", more: str = "") -> str:
    """An actuator on the joint `pin` that acts 250 times a second, with `more` keys of its servo, and the step."""
    return DRIVE.format(delay=delay, more=more)


def sampled_arm(name: str, *, delay: str = "0 s", more: str = "") -> str:
    """An arm on such an actuator."""
    return ARM.format(name=name) + sampled_drive(delay=delay, more=more)
