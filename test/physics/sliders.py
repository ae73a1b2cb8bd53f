"""A mass on a vertical rail, for laws along one coordinate."""

from mbd_sim import Simulation

SLIDER = """
mechanism: slider
gravity: GRAVITY
ground: {points: {top: [0, 0, 2]}}
parts: {mass: {mass: 2}}
joints:
  rail: {type: prismatic, between: [ground, mass], axis: [0, 0, 1], JOINT}
  FORCE
"""


def slider(joint="", force="", gravity="[0, 0, 0]", **options):
    text = SLIDER.replace("JOINT", joint).replace("GRAVITY", gravity)
    return Simulation.from_text(text.replace("  FORCE", f"forces:\n  {force}" if force else ""), **options)
