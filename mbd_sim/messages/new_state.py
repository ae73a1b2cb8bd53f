"""The message of a new state: everything that the run depends on from there, in one labeled array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.messages.state_messages import labeled_array
from mbd_sim.simulation.snapshot import RunPoint

HISTORY, SAMPLES = "history", "samples"  # after the live values, in this order, if there are any
LABELS = ("steps", "start_energy", "state", "inputs")  # before those of the live values


def new_state_message(new: RunPoint) -> bytes:
    """The state as a `std_msgs/msg/Float64MultiArray`; live values are labeled with their keys."""
    labels, sizes = [*LABELS, *new.live], [1, 1, len(new.state), len(new.inputs), *[1] * len(new.live)]
    numbers = [new.steps, new.start_energy, *new.state, *new.inputs, *new.live.values()]
    for label, array in ((HISTORY, new.history), (SAMPLES, new.samples)):
        if array.size:
            labels, sizes, numbers = [*labels, label], [*sizes, array.size], [*numbers, *array.ravel()]
    message, values = labeled_array(labels, sizes)
    values[:] = numbers
    return message.payload()


def parse_new_state(
    labels: Sequence[str], values: Array, state_size: int, input_size: int, history_size: int
) -> RunPoint:
    """The state from the labels and the numbers of its message.

    :raises ValueError: they do not fit a state, inputs and a history of these sizes.
    """
    keys = [label for label in labels[len(LABELS) :] if label not in (HISTORY, SAMPLES)]
    kept, width = history_size if HISTORY in labels else 0, 1 + state_size + input_size
    sizes = [1, 1, state_size, input_size, len(keys), kept]
    samples = values[sum(sizes) :]
    if tuple(labels[: len(LABELS)]) != LABELS or len(values) < sum(sizes) or len(samples) % width:
        raise ValueError(f"a new state of {len(values)} numbers does not fit: {sum(sizes)} are needed")
    steps, energy, state, inputs, live, history = np.split(values[: sum(sizes)], np.cumsum(sizes)[:-1])
    by_key = dict(zip(keys, live.tolist(), strict=True))
    return RunPoint(int(steps[0]), state, inputs, float(energy[0]), by_key, samples.reshape(-1, width), history)
