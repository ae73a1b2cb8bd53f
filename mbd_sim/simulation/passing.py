"""Says where parts turn so far within a step, or fly so fast, that a contact between its ends may be missed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.dynamics.passing import PassingFunctions
from mbd_sim.dynamics.state_scales import natural_units
from mbd_sim.errors import listed
from mbd_sim.geometry.pose import Array
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.step_advice import round_down

TURN = 0.5  # rad within a step, up to which the rates of a gap at its ends show whether it closes between them
STILL = 1e-6  # of the natural length, by which a place may move while its part turns


def passing_advice(model: Model, time: float, y: Array, inputs: Array, step: float) -> Iterator[str]:
    """A sentence on the contacts that steps of `step` s may miss in this state, with a step that does not."""
    if (functions := model.passing) is None:
        return
    given = inputs[: model.input_layout.values.start]
    turning, second, third, speed = evaluated(functions.motions, time, y, given)
    least = STILL * natural_units(model.mechanism, step).length
    moves = (second > least * turning**2) | (third > least * turning**3)
    if names := _names(functions, turns := moves & (turning * step > TURN)):
        fastest = float(np.max(turning[turns]))
        yield (
            f"parts at {listed(names)} turn by {fastest * step:.3g} rad in a step of {step:g} s, so that contacts "
            f"within it may be missed. Try step {round_down(TURN / fastest):g}."
        )
    sizes = np.array([np.inf if size is None else size for size in functions.sizes])
    if names := _names(functions, passes := speed * step > sizes):
        farthest, shortest = float(np.max(speed[passes])) * step, float(np.min(sizes[passes] / speed[passes]))
        yield (
            f"bodies at {listed(names)} move by up to {farthest:.3g} m in a step of {step:g} s, "
            f"and can pass each other within it, as the contact is compliant. Try step {round_down(0.1 * shortest):g}, "
            "or make the contact rigid."
        )


def _names(functions: PassingFunctions, which: Array) -> list[str]:
    return list(dict.fromkeys(f"'{functions.names[index]}'" for index in np.flatnonzero(which)))
