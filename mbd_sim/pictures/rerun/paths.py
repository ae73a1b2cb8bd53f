"""The paths of entities in a recording of Rerun, and the units of those that are plotted."""

from __future__ import annotations

import re

from mbd_sim.mechanism.elements.parts import GROUND

TIMELINE = "sim_time"
WORLD = "world"
ABOUT = "about"
CONTACTS = f"{WORLD}/contact_forces"
EVENTS = "events/log"
STATES = "events/states"
JOINTS = "joints"
POSITION, VELOCITY, EFFORT = (f"{JOINTS}/{kind}" for kind in ("position", "velocity", "effort"))
REACTION = f"{JOINTS}/reaction"
ACCOUNT = "energy/account"
STACK = "energy/stack"
RESIDUAL = "energy/residual"
RESIDUAL_PJ = "energy/residual_pJ"  # Rerun's plots label axes without exponents: in J they would show zeros
PICO = 1e-12

ANGULAR, LINEAR = "angular", "linear"
UNITS = {  # of the plots, by the paths of their entities
    f"{POSITION}/{ANGULAR}": "rad",
    f"{POSITION}/{LINEAR}": "m",
    f"{VELOCITY}/{ANGULAR}": "rad/s",
    f"{VELOCITY}/{LINEAR}": "m/s",
    f"{EFFORT}/{ANGULAR}": "N·m",
    f"{EFFORT}/{LINEAR}": "N",
}


def word(name: str) -> str:
    """A name as one step of a path, as Rerun escapes it."""
    return re.sub(r"[^\w.-]", lambda found: _escaped(found[0]), name)


def _escaped(letter: str) -> str:
    return f"\\{letter}" if letter.isascii() else f"\\u{{{ord(letter):04X}}}"


def in_world(kind: str, name: str) -> str:
    """An entity of a kind in ground's frame."""
    return f"{WORLD}/{kind}/{word(name)}"


def part(name: str) -> str:
    """The entity that moves with a part; ground's does not move."""
    return f"{WORLD}/ground" if name == GROUND else in_world("parts", name)


def trace(name: str) -> str:
    """The trace that a point leaves, in ground's frame."""
    return in_world("traces", name)


def sensor(name: str, quantity: str) -> str:
    """The measurements of a quantity by a sensor."""
    return f"sensors/{word(name)}/{quantity}"
