"""Compares recorded measurements of sensors with those that a recomputation gives."""

from __future__ import annotations

import struct

import numpy as np

from mbd_sim.messages.sensor_messages import Numbers
from mbd_sim.messages.sensor_topics import SensorMessages
from mbd_sim.recording.recomputation import Recomputation
from mbd_sim.recording.recorded_file import Message, ReadingError

NumberDifference = tuple[str, float, float]  # the name of a number, as recorded, and as computed


class SensorComparison:
    """The messages of sensors in a recomputed run."""

    def __init__(self, recomputation: Recomputation) -> None:
        """Prepare the messages, with the frame names that the node was given."""
        self._recomputation, simulation = recomputation, recomputation.simulation
        self._messages = SensorMessages(simulation.model, simulation.step_size, recomputation.frame_prefix)
        self._numbers = {name.rpartition("/")[2]: number for number, name in enumerate(self._messages.names)}

    def differences(self, message: Message, tolerance: float | None) -> list[NumberDifference]:
        """The numbers of a message that differ from the computed ones: bit for bit, or by more than a tolerance.

        The tolerance is relative to 1 + the largest number of the quantity, beside one step of a value that is rounded.

        :raises ReadingError: it is not a message of its sensor, or nothing is measured at this step.
        """
        name = message.topic.rpartition("/")[2]
        number = self._numbers.get(name)
        if number is None:
            raise ReadingError(f"the mechanism has no sensor '{name}'")
        arrivals = {arrival.sensor: arrival for arrival in self._recomputation.simulation.arrivals}
        if number not in arrivals:
            raise ReadingError("no measurement arrives at this step")
        ((_, expected, *_),) = self._messages.measured([arrivals[number]], message.time_ns)
        if message.payload == expected:
            return []
        if len(message.payload) != len(expected) or message.payload[:4] != expected[:4]:
            raise ReadingError(f"has {len(message.payload)} bytes, not the {len(expected)} of its sensor's message")
        return self._number_differences(number, message.payload, expected, tolerance)

    def _number_differences(
        self, number: int, recorded: bytes, expected: bytes, tolerance: float | None
    ) -> list[NumberDifference]:
        writer, found = self._messages.writers[number], list[NumberDifference]()
        differing = {index for index, (one, other) in enumerate(zip(recorded, expected, strict=True)) if one != other}
        for name, view in writer.views.items():
            start = writer.message.offset_of(view)
            places = range(start, start + view.nbytes)
            own = differing.intersection(places)
            differing -= own
            if own:
                found += self._in_view(number, name, view, recorded[start : places.stop], tolerance)
        if differing:
            first = min(differing)
            place = f"byte {first} of the message"
            found.append((place, float(recorded[first]), float(expected[first])))
        return found

    def _in_view(
        self, number: int, quantity: str, view: Numbers, recorded: bytes, tolerance: float | None
    ) -> list[NumberDifference]:
        numbers = np.frombuffer(recorded, dtype=view.dtype)
        letters = "xyzw" if len(view) > 1 else " "
        pairs = zip(letters, numbers.tolist(), view.tolist(), strict=False)
        if tolerance is None:
            return [
                (f"{quantity} {letter}".strip(), one, other)
                for letter, one, other in pairs
                if struct.pack("<d", one) != struct.pack("<d", other)
            ]
        bound = tolerance * (1.0 + float(np.max(np.abs(view)))) + self._messages.rounding(number, quantity)
        return [
            (f"{quantity} {letter}".strip(), one, other)
            for letter, one, other in pairs
            if not (abs(one - other) <= bound or one == other)
        ]
