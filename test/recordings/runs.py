"""Recorded runs under random commands, by the threads and the recorder of a node that a test steps."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import rclpy

from mbd_sim.ros.node.sim_node import SimNode
from test.system.nodes import new_domain

Action = Callable[[SimNode, random.Random], None]


@contextlib.contextmanager
def stepped_node(folder: Path, mechanism: str, **parameters: Any) -> Iterator[SimNode]:
    """Yield a paused node in this process, which the test steps."""
    given = {
        "mechanism": mechanism, "start_paused": True, "record": True, "record_dir": folder, "real_time_factor": 0.0,
        "marker_rate": 0.0, "real_time_priority": 0, "command_timeout": 0.25,
    } | parameters  # fmt: skip
    arguments = ["--ros-args", "--log-level", "ERROR"]
    for name, value in given.items():
        arguments += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
    rclpy.init(args=arguments, domain_id=new_domain())
    try:
        node = SimNode(lambda: None)
        node.start()
        try:
            yield node
        finally:
            node.stop()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def record_run(
    folder: Path,
    mechanism: str,
    *,
    seconds: float = 1.0,
    seed: int = 1,
    commands: int = 10,
    resets: bool = True,
    **parameters: Any,
) -> Path:
    """Record a run with random commands; return the file."""
    with stepped_node(folder, mechanism, **parameters) as node:
        drive(node, seconds, commands, random.Random(seed), ACTIONS if resets else ACTIONS[:-1])
        recorder = node.publishing_thread.recorder
    return Path(recorder.path)


def drive(node: SimNode, seconds: float, commands: int, chance: random.Random, actions: Sequence[Action]) -> None:
    """Step a node for some simulated seconds, with random commands in between."""
    left = max(1, round(seconds / node.simulation.step_size))
    for number in range(commands):
        chance.choice(actions)(node, chance)
        steps = (
            left // (commands - number)
            if number + 1 == commands
            else chance.randint(0, 2 * left // (commands - number))
        )
        steps = min(steps, left)
        node.stepping_thread.step(steps)
        left -= steps


def _efforts(node: SimNode, chance: random.Random) -> None:
    names = node.simulation.coordinate_names
    node.commands.by_order([chance.gauss(0.0, 0.3) for _ in names])


def _wrench(node: SimNode, chance: random.Random) -> None:
    if parts := node.wrenches.loaded:
        part = chance.choice(parts)
        frame = chance.choice(["ground", part, chance.choice(node.simulation.model.part_names)])
        point = chance.choice([None, *node.simulation.mechanism.parts[part].points])
        force, couple = ([chance.gauss(0.0, 0.2) for _ in range(3)] for _ in range(2))
        node.wrenches.take(part, point, frame, force, couple)


def _live(node: SimNode, chance: random.Random) -> None:
    live = dict(node.simulation.live)
    keys = [key for key in live if "damping" in key or key.startswith("gravity")]
    if keys:
        key = chance.choice(keys)
        node.stepping_thread.set_live({key: live[key] * chance.uniform(0.9, 1.1)})


def _reset(node: SimNode, chance: random.Random) -> None:
    node.stepping_thread.reset(rewind_clock=chance.random() < 0.5)


ACTIONS: list[Action] = [_efforts, _efforts, _efforts, _wrench, _wrench, _live, _reset]
