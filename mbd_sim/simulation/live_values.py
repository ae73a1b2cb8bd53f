"""Values of a mechanism that change while it runs, without a new kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim.dynamics.symbolic_parameters import (
    Numbers,
    UnvariedError,
    Values,
    numbers_of,
    values_among,
)
from mbd_sim.errors import CommandError, MechanismError, Problem, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.override import matching, value_of, with_values

_PROBES = (1.01, 0.99)  # times a value, to see what depends on it
_FROM_ZERO = (1e-3, -1e-3)


class LiveValues:
    """The live values of a mechanism by their keys in its file, see `with_values`; `current` are in SI units."""

    def __init__(self, mechanism: Mechanism, names: Sequence[str]) -> None:
        """Find out on which numbers of the equations the named values act.

        :param names: keys, or patterns such as `joints.*.damping`, of which only those count that can be live.
        :raises MechanismError: a key does not exist, or its value is built into the equations.
        """
        self._mechanism = mechanism
        base = numbers_of(mechanism)
        found: dict[str, Numbers] = {}
        problems: list[Problem] = []
        for name in names:
            patterned = "*" in name
            for key in matching(mechanism, [name]) if patterned else [name]:
                try:
                    found[key] = _probed(mechanism, key, base)
                except UnvariedError as error:
                    if not patterned:
                        remedy = "Change the file, and start anew."
                        problems.append(Problem(f"cannot change while it runs: {error}", remedy, key=key))
        if problems:
            raise MechanismError(problems)
        self.current: dict[str, float] = {key: value_of(mechanism, key) or 0.0 for key in found}
        self.values: Values = values_among(base, list(found.values()))

    def changed(self, changes: Mapping[str, float]) -> tuple[dict[str, float], Array]:
        """All values by key after a change, and those among the inputs of the equations.

        :raises CommandError: an unknown key, a value that does not fit, or that acts on more than when it was probed.
        """
        for key in changes:
            if key not in self.current:
                raise CommandError(f"'{key}' is not a live value. {nearest(key, self.current)}")
        current = {**self.current, **{key: float(value) for key, value in changes.items()}}
        try:
            return current, self.values.of(numbers_of(with_values(self._mechanism, current)))
        except MechanismError as error:
            raise CommandError(
                "; ".join(f"{p.key}: {p.message}. {p.remedy}".strip() for p in error.problems)
            ) from error
        except UnvariedError as error:
            raise CommandError(f"{', '.join(changes)}: {error}. Change the file, and start anew.") from error


def _probed(mechanism: Mechanism, key: str, base: Numbers) -> Numbers:
    """The numbers with another value at a key.

    :raises UnvariedError: it is not a number, or acts on what is built into the equations, or on nothing in them.
    :raises MechanismError: there is no such key.
    """
    value = value_of(mechanism, key)
    if value is None:
        raise UnvariedError("it is not a number")
    tries = [factor * value for factor in _PROBES] if value else list(_FROM_ZERO)
    for attempt, probe in enumerate(tries):
        try:
            numbers = numbers_of(with_values(mechanism, {key: probe}))
        except MechanismError as error:
            if attempt + 1 == len(tries):
                raise UnvariedError(f"no value near {value:g} is possible: {error.problems[0].message}") from error
            continue
        values = values_among(base, [numbers])
        if not len(values.base):
            raise UnvariedError("the equations of motion do not depend on it")
        return numbers
    raise AssertionError("there is a last try")
