"""A column of two rods under a force that follows the upper one (Ziegler 1952)."""

COLUMN = """
mechanism: column
gravity: [0, 0, 0]
parameters: {P: 1, c: 0}
parts:
  lower: {mass: 2, center: [0, 0, 1], points: {top: [0, 0, 1]}}
  upper: {mass: 1, center: [0, 0, 1], points: {top: [0, 0, 1]}}
joints:
  foot: {type: revolute, between: [ground, lower], axis: [0, 1, 0], stiffness: 1, damping: c}
  knee: {type: revolute, between: [lower.top, upper], axis: [0, 1, 0], stiffness: 1, damping: c}
forces:
  push: {type: force, at: upper.top, vector: [0, 0, -P], axes: part}
"""
