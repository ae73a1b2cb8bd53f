"""The mechanism on the bench: a simulation whose numbers can all change, and which can be taken hold of.

A bench belongs to one thread. Everything it does goes through the public interface of `Simulation`, so that a recording
of it can be recomputed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.hold import Hold, at_rest, pulled, spring_for
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.live_values import names_with_matches
from mbd_sim.simulation.model.penetrations import require_outside
from mbd_sim.simulation.run.simulation import BaseSimulation

LIVE = (  # what can change while it runs, as far as the equations allow it
    "parameters.*",
    "gravity[*]",
    "joints.*.stiffness",
    "joints.*.damping",
    "joints.*.friction.*",
    "forces.*.stiffness",
    "forces.*.damping",
    "forces.*.length",
    "contacts.*.restitution",
    "contacts.*.friction",
    "constraints.*.restitution",
    "constraints.*.friction",
    "actuators.*.servo.k*",
)
PULL_PERIOD = 2e-3  # s of simulated time between two changes of the force of a hand


class Bench:
    """A simulation with live values, and with a wrench on every part that has mass.

    `message` is what the user should know about the last motion.
    """

    positions_only = False
    drive = ""
    message = ""

    def __init__(self, simulation: BaseSimulation) -> None:
        self.simulation = simulation
        self.file = dict(simulation.live)  # the live values of the file
        self.hold: Hold | None = None
        self.period = max(1, round(PULL_PERIOD / simulation.step_size))  # steps

    @classmethod
    def of(
        cls, mechanism: Mechanism, *, method: str | None = None, step: float | None = None, live: Sequence[str] = ()
    ) -> Bench:
        """Build the simulation of a mechanism; `method` and `step` (s) replace those of its file.

        :param live: more values that can change.

        :raises MechanismError: with all problems of the file.
        """
        live = [*names_with_matches(mechanism, LIVE), *live]
        movable = [name for name, part in mechanism.parts.items() if part.mass]
        return cls(BaseSimulation(mechanism, live=live, wrenches=movable, method=method, step=step))

    def advance(self, steps: int) -> None:
        """Take steps; the force of the hand changes at multiples of `period`.

        :raises DivergedError: the motion would become infinite.
        """
        simulation, last = self.simulation, self.simulation.steps + steps
        while simulation.steps < last:
            if self.hold is not None and simulation.steps % self.period == 0:
                self.hold.apply(simulation)
            simulation.step(min(self.period - simulation.steps % self.period, last - simulation.steps))

    def take_hold(self, part: str, point: Array, target: Array) -> None:
        """Attach a spring and a damper between a point (3,) of a part, in its frame, and a `target` (3,) in ground's.

        Parts without mass are not pulled.
        """
        if part in self.simulation.wrench_map.slices:
            self.let_go()
            self.hold = spring_for(self.simulation, part, point, target)

    def pull_to(self, target: Array) -> None:
        """Move the far end of the spring of the hand to a point (3,) in ground's frame."""
        if self.hold is not None:
            self.hold = replace(self.hold, target=target)

    def let_go(self) -> None:
        """Remove the force of the hand."""
        if self.hold is not None:
            self.simulation.set_wrench(self.hold.part)
            self.hold = None

    def clear_wrenches(self) -> None:
        """Remove the force of a hand that the state at hand still contains."""
        for part in self.simulation.wrench_map.slices:
            self.simulation.set_wrench(part)

    def drag(self, part: str, point: Array, target: Array) -> None:
        """Move through the configurations, with loops closed, so that a point of a part comes close to a `target`.

        The mechanism is at rest afterward, as far as its drives allow. The energy account begins there.
        """
        y = pulled(self.simulation, part, point, target)
        if y is not None:
            self._go_to(y)

    def put(self, q: Array) -> None:
        """Put the mechanism at rest, as far as its drives allow, at coordinates (nq,) with closed loops.

        The energy account begins there.

        :raises CommandError: parts would be inside each other, or beyond a stop; nothing is changed then.
        """
        simulation, y = self.simulation, at_rest(self.simulation, q)
        require_outside(simulation.model, simulation.time, y, np.asarray(simulation.inputs))
        self._go_to(y)

    def _go_to(self, y: Array) -> None:
        """Go on from another state, with the residual of the energies as it is."""
        simulation, model = self.simulation, self.simulation.model
        before = simulation.energies.total
        model.keep_accounts(simulation.time, simulation.state, y, simulation.inputs)
        after = model.energies(simulation.time, y, 0.0, simulation.inputs).total
        simulation.restore(y, simulation.steps, start_energy=simulation.start_energy + after - before)

    def values(self) -> dict[str, float]:
        """The live values, efforts and commands by their keys, in SI units."""
        simulation, model = self.simulation, self.simulation.model
        commands = simulation.inputs[model.input_layout.commands].tolist()
        return {
            **simulation.live,
            **dict(zip(simulation.coordinate_names, simulation.efforts.tolist(), strict=True)),
            **dict(zip(simulation.command_map.names, commands, strict=True)),
        }
