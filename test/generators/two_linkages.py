"""A parallelogram that lies flat, and a second linkage beside it."""

TWO = """
mechanism: two_linkages
gravity: [0, 0, 0]
ground: {points: {d: [1, 0, 0], e: [0, 5, 0], f: [END, 5, 0]}}
parts:
  crank: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  bar: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
  crank2: {mass: 1, shape: {type: rod, to: [LENGTH, 0, 0]}, points: {tip: [LENGTH, 0, 0]}}
  bar2: {mass: 1, shape: {type: rod, to: [1, 0, 0]}, points: {tip: [1, 0, 0]}}
  rocker2: {mass: 1, shape: {type: rod, to: [0.4, 0, 0]}, points: {tip: [0.4, 0, 0]}}
joints:
  main: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0, velocity: SPEED}
  pin: {type: revolute, between: [crank.tip, bar], axis: [0, -1, 0]}
  other: {type: revolute, between: [ground.d, rocker], axis: [0, -1, 0]}
  eye: {type: revolute, between: [bar.tip, rocker.tip], axis: [0, -1, 0]}
  main2: {type: revolute, between: [ground.e, crank2], axis: [0, -1, 0], position: ANGLE, velocity: SECOND}
  pin2: {type: revolute, between: [crank2.tip, bar2], axis: [0, -1, 0], position: LEAN, guess: true}
  other2: {type: revolute, between: [ground.f, rocker2], axis: [0, -1, 0], position: ANGLE, guess: true}
  eye2: {type: revolute, between: [bar2.tip, rocker2.tip], axis: [0, -1, 0]}
"""


def two_linkages(**values):
    """The text with values for END, LENGTH, ANGLE, LEAN, SPEED and SECOND."""
    text = TWO
    for name, value in values.items():
        text = text.replace(name, str(value))
    return text
