"""The session on the run of a node: it shows copies of the node's states, and sends what pages ask to the node.

It runs in a process of its own, so that pages cannot delay the node. The node does with the requests what it does with
messages of the same content; nothing else changes its run.
"""

from __future__ import annotations

import json
import math
import pickle
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics
from mbd_sim.base.errors import CommandError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.hold import at_rest, pulled, spring_for
from mbd_sim.lab.session.link import NodeState, SocketEnd
from mbd_sim.lab.session.session import Session
from mbd_sim.simulation.model.penetrations import require_outside

STILL = 1e-9  # rad or m, by which a drive has not moved
LIVE_PERIOD = 0.1  # s between changes of live values, each of which the node validates for milliseconds


class NodeSession(Session):
    """Shows a bench that is put into the states of a node. It ends with its `link` to the node."""

    of_node = True

    def __init__(self, bench: Bench, link: SocketEnd, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._link, self._requests, self._live = link, list[list[Any]](), dict[str, float]()
        self._changed = -math.inf  # s of the clock, when live values were sent
        self._state: NodeState | None = None
        super().__init__(bench, running=False, clock=clock)

    def wait(self) -> None:
        """Wait for the end."""
        self._stopped.wait()

    @property
    def recording(self) -> str:
        """See `Session`."""
        return self._state.recording if self._state else ""

    def _go_on(self) -> None:
        """Send the requests of this turn, and take the state of the node after them."""
        hold, simulation = self.bench.hold, self.bench.simulation
        if hold is not None:
            point, target = hold.point.tolist(), hold.target.tolist()
            self._send("pull", hold.part, point, target, hold.stiffness, hold.damping, hold.strongest)
        if self._live and self._clock() - self._changed >= LIVE_PERIOD:
            self._send("live", self._live)
            self._live, self._changed = {}, self._clock()
        requests, self._requests = self._requests, []
        try:
            self._link.send(json.dumps({"requests": requests, "pages": len(self.pages)}).encode())
            answer = self._link.receive()
        except OSError:
            self._stopped.set()
            return
        assert answer is not None
        state = self._state = pickle.loads(answer)  # noqa: S301  (from the node that started this process)
        before = simulation.time
        simulation.restore(state.point)
        if simulation.time < before:
            self.history.clear()
            self.samples.rows.clear()
        if self.running != state.running:
            self.running, self._rate = state.running, 0.0
        self.speed = state.speed or math.inf
        if hold is not None and not self.running:
            self.let_go()
        self.message = state.told or self.message
        self._measure_rate(max(0.0, simulation.time - before))
        if simulation.time != before:
            self._remember()

    def _send(self, name: str, *arguments: Any) -> None:
        self._requests.append([name, *arguments])

    def play(self) -> None:
        """See `Session`."""
        self.message = ""
        self._send("pause", False)

    def pause(self) -> None:
        """See `Session`."""
        self.let_go()
        self._send("pause", True)

    def step(self, steps: int | None = None) -> None:
        """Pause, and take the steps of the node's parameter `step_count`."""
        self.pause()
        self._send("step")

    def reset(self) -> None:
        """See `Session`."""
        self.let_go()
        self._send("reset")

    def set_speed(self, speed: float) -> None:
        """See `Session`."""
        self._send("speed", speed if math.isfinite(speed) else 0.0)

    def wind_to(self, time: float) -> None:
        """Refuse.

        :raises CommandError: always.
        """
        raise CommandError("a node is not wound back", "Reset it.")

    def step_back(self) -> None:
        """Refuse, see `wind_to`."""
        self.wind_to(self.frame.time)

    def change(self, key: str, value: float) -> None:
        """See `Session`; changes within `LIVE_PERIOD` are one, accepted or rejected as a whole."""
        self._live[key] = value

    def set_effort(self, name: str, value: float) -> None:
        """See `Session`."""
        self._send("effort", name, value)

    def set_command(self, name: str, value: float) -> None:
        """See `Session`."""
        self._send("command", name, value)

    def set_state(self, positions: Mapping[str, float], velocities: Mapping[str, float]) -> None:
        """See `Session`."""
        self._send("state", positions, velocities)

    def drive_to(self, position: float) -> None:
        """Refuse.

        :raises CommandError: always.
        """
        raise CommandError("a node has no mechanism of positions")

    def take_hold(self, part: str, point: Array, target: Array) -> None:
        """See `Session`."""
        if part not in self.bench.simulation.wrench_map.slices:
            raise CommandError(f"part '{part}' accepts no wrench", "Start the node with wrenches:=all.")
        self.let_go()
        self.bench.hold = spring_for(self.bench.simulation, part, point, target)

    def let_go(self) -> None:
        """See `Session`."""
        if self.bench.hold is not None:
            self._send("release", self.bench.hold.part)
            self.bench.hold = None

    def leave(self, page: int) -> None:
        """A page was closed: its hand and its commands are left to the watchdogs of the node."""
        self.pages.discard(page)
        if page == self._holder and self.bench.hold is not None:
            self._send("abandon", self.bench.hold.part)
            self.bench.hold = None

    def place(self, part: str, point: Array, target: Array) -> None:
        """See `Session`."""
        y = pulled(self.bench.simulation, part, point, target)
        if y is not None:
            self._send_state(y)

    def put(self, found: InverseKinematics) -> None:
        """See `Session`."""
        simulation = self.bench.simulation
        drives = simulation.model.layout.drives
        places = [place.start for place in drives.values()]
        if not np.allclose(found.q[places], simulation.q[places], rtol=0.0, atol=STILL):
            raise CommandError(f"the drives of {listed(list(drives))} follow commands", "Press *Command the joints*.")
        y = at_rest(simulation, found.q)
        require_outside(simulation.model, simulation.time, y, np.asarray(simulation.inputs))  # as the node does
        self.pause()
        self._send_state(y)

    def _send_state(self, y: Array) -> None:
        """Ask for the positions and speeds of a state of the paused mechanism."""
        model, names = self.bench.simulation.model, self.bench.simulation.coordinate_names
        positions = dict(zip(names, model.coordinates(y).tolist(), strict=True))
        speeds = dict(zip(names, y[model.u_range].tolist(), strict=True))
        self._send("place", positions, speeds)

    def record(self, path: Path | str) -> None:
        """Start a recording; the node names it."""
        self._send("record", True)

    def end_recording_told(self) -> None:
        """See `Session`."""
        self._send("record", False)
