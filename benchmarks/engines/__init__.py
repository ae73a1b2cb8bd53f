"""The simulators that are compared: one module each, all with the same interface."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from benchmarks.plan import Array, Plan

OURS = "mbd_sim"
CLASSES = {
    OURS: "MbdSim",
    "mujoco": "MuJoCo",
    "pinocchio": "Pinocchio",
    "drake": "Drake",
    "exudyn": "Exudyn",
    "heyoka": "Heyoka",
}
NAMES = CLASSES | {OURS: "mbd_sim", "heyoka": "heyoka"}


class Engine(Protocol):
    """A plan in one simulator, with one of its methods and a fixed step."""

    each: Callable[[int], None] | None
    """Takes a number of steps with one call per step in a minimal Python loop; None if the simulator cannot do that."""

    def many(self, steps: int) -> None:
        """Take a number of steps with as few calls as the simulator allows."""

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds, in the plan's order."""


@dataclass(frozen=True)
class Candidate:
    """A simulator with one of its methods."""

    module: str
    method: str
    key: str

    @property
    def label(self) -> str:
        """The name in the tables."""
        return f"{NAMES[self.module]} {self.method}"

    def build(self, plan: Plan, step: float) -> Engine:
        """The engine that runs a plan."""
        kind = getattr(load(self.module), CLASSES[self.module])
        return kind(plan, step, self.key)


def load(module: str):
    """The module of a simulator.

    :raises ImportError: it is not installed.
    """
    return importlib.import_module(f"benchmarks.engines.{module}")


def candidates(modules: list[str]) -> tuple[list[Candidate], list[str]]:
    """The installed simulators with each of their methods, and for each simulator its version, or why it is omitted."""
    found, lines = [], []
    for module in modules:
        try:
            loaded = load(module)
        except ImportError as error:
            lines.append(f"{NAMES[module]}: omitted, not installed ({error})")
            continue
        lines.append(f"{NAMES[module]} {loaded.VERSION}")
        found += [Candidate(module, method, key) for method, key in loaded.METHODS.items()]
    return found, lines
