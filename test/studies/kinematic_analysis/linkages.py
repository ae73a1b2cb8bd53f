"""Plane linkages as mechanism files, and their closed forms."""

import numpy as np

from mbd_sim import parse_mechanism

FOUR_BAR = """
mechanism: plane_four_bar
parameters: {{a: {a}, b: {b}, c: {c}, d: {d}, px: 0.7, py: 0.4}}
ground: {{points: {{right: [d, 0, 0]}}}}
parts:
  crank: {{mass: 1, shape: {{type: rod, to: [a, 0, 0]}}, points: {{tip: [a, 0, 0]}}}}
  coupler: {{mass: 2, shape: {{type: rod, to: [b, 0, 0]}}, points: {{tip: [b, 0, 0], tracer: [px, py, 0]}}}}
  rocker: {{mass: 1.5, shape: {{type: rod, to: [c, 0, 0]}}, points: {{tip: [c, 0, 0]}}}}
joints:
  motor: {{type: revolute, between: [ground, crank], axis: [0, 0, 1], position: {start} deg}}
  pin: {{type: revolute, between: [crank.tip, coupler], axis: [0, 0, 1], position: {guess} deg, guess: true}}
  pivot: {{type: revolute, between: [ground.right, rocker], axis: [0, 0, 1], position: 100 deg, guess: true}}
  rocker_pin: {{type: revolute, between: [coupler.tip, rocker.tip], axis: [0, 0, 1], cut: true}}
"""


def four_bar(a=0.5, b=1.4, c=1.2, d=1.5, start=60, guess=-20):
    """Crank a, coupler b, rocker c on pivots d apart."""
    return parse_mechanism(FOUR_BAR.format(a=a, b=b, c=c, d=d, start=start, guess=guess))


def rocker_angles(theta, a=0.5, b=1.4, c=1.2, d=1.5):
    """Angle, velocity and acceleration of the rocker of the open four-bar for a unit speed of the crank.

    The angle by the law of cosines; its derivatives from K1 cos φ - K2 cos θ + K3 = cos(θ - φ) (Freudenstein 1955).
    """
    across = d - a * np.exp(1j * theta)
    reach = np.abs(across)
    phi = np.angle(-across) - np.arccos((c**2 + reach**2 - b**2) / (2 * c * reach))
    k1, k2 = d / a, d / c
    by_theta, by_phi = k2 * np.sin(theta) + np.sin(theta - phi), -k1 * np.sin(phi) - np.sin(theta - phi)
    first = -by_theta / by_phi
    curvature = np.cos(theta - phi)
    by_both = k2 * np.cos(theta) + curvature - 2 * curvature * first + (curvature - k1 * np.cos(phi)) * first**2
    return np.mod(phi, 2 * np.pi), first, -by_both / by_phi


def tracer(theta, px=0.7, py=0.4, a=0.5, b=1.4, c=1.2, d=1.5):
    """The path of the coupler's tracer in the complex plane."""
    phi = rocker_angles(theta, a, b, c, d)[0]
    tip = a * np.exp(1j * theta)
    return tip + (px + 1j * py) * (d + c * np.exp(1j * phi) - tip) / b


def few_starts(monkeypatch):
    """Search assembly modes from 30 starts, which find both of a four-bar."""
    for name in ("LEAST", "BATCH"):
        monkeypatch.setattr(f"mbd_sim.studies.kinematic_analysis.modes.{name}", 30)
