"""Live values: numbers of a mechanism file that change during a run, without another kernel."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim import dynamics
from mbd_sim.errors import CommandError, MechanismError, Problem, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_cache import cached, records_digest
from mbd_sim.mechanism_file.override import location_of, matching, value_of, values_of, with_values
from mbd_sim.simulation.efforts import EffortMap

if TYPE_CHECKING:
    from mbd_sim.dynamics.symbolic_parameters import EquationData, SymbolicParameters

LARGEST_GAP = 1e-6  # violation of the constraints that a change of live values may leave, m or 1
_PROBE_FACTORS = (1.01, 0.99)  # applied to a value to find the numbers that depend on it
_PROBES_OF_ZERO = (1e-3, -1e-3)


class PreparedValues(NamedTuple):
    """Validated changes of live values: the changes, all live values after them, and the values (n,) in the inputs.

    The changes include those of values that follow the given ones. `given` are all values that have been given, from
    which the others follow; `mechanism` is the one with these values.
    """

    changes: Mapping[str, float]
    given: Mapping[str, float]
    current: Mapping[str, float]
    inputs: Array
    mechanism: Mechanism


class LiveParameters:
    """The numbers of a mechanism's equations that depend on live values, as symbols when equations are traced."""

    def __init__(self, mechanism: Mechanism, indices: NDArray[np.intp], columns: NDArray[np.intp], base: Array) -> None:
        """`indices`, `columns` and `base` are those of `SymbolicParameters`."""
        self._mechanism, self._numbers = mechanism, (indices, columns, base)

    @property
    def digest(self) -> str:
        """Equal for the same numbers of the same mechanism."""
        return hashlib.sha256(b" ".join(array.tobytes() for array in self._numbers)).hexdigest()

    @cached_property
    def symbolic(self) -> SymbolicParameters:
        """The symbols, which need CasADi."""
        return dynamics.SymbolicParameters(dynamics.equation_data(self._mechanism), *self._numbers)


class LiveValues:
    """The live values of a mechanism by their keys in its file, see `with_values`; `current` are in SI units.

    A value that has not been given itself follows the others, as its formula in the file says: after
    `damping: 2*d`, it changes with the parameter d.
    """

    def __init__(self, mechanism: Mechanism, names: Sequence[str]) -> None:
        """Find the numbers of the equations that depend on the named values: the `parameters`, None without names.

        :param names: keys, or patterns such as `joints.*.damping`, which stand for those matches that can be live.
        :raises MechanismError: a key does not exist, or its value is built into the equations.
        """
        self._mechanism = mechanism
        self.current: dict[str, float] = {}
        self.parameters: LiveParameters | None = None
        if names:
            found = _found(mechanism, names)
            self.current = found.current
            self.parameters = LiveParameters(mechanism, found.indices, found.columns, found.values)
        self._of_file = self.current
        self._given: Mapping[str, float] | None = {}  # None: not known, but found in `current` when needed
        self._changed, self._changed_with = mechanism, self.current

    def copy(self) -> LiveValues:
        """The same values, which change by themselves."""
        return copy(self)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with the current values."""
        if self._changed_with is not self.current:
            self._changed, self._changed_with = with_values(self._mechanism, self.current), self.current
        return self._changed

    def apply(self, prepared: PreparedValues) -> None:
        """Make prepared values the current ones."""
        self.current, self._given = dict(prepared.current), prepared.given
        self._changed, self._changed_with = prepared.mechanism, self.current

    def restore(self, values: Mapping[str, float]) -> None:
        """Make earlier values the current ones, as far as they are given."""
        if (current := {**self.current, **values}) != self.current:
            self.current, self._given = current, None

    def given_among(self, values: Mapping[str, float]) -> dict[str, float]:
        """Those of the values of a run that have been given; the others follow from them."""
        run = self.copy()
        run.restore(values)
        return dict(run._given_values())

    def limit(self, efforts: EffortMap) -> None:
        """Limit efforts as the mechanism with the current values does."""
        if self.current:
            efforts.limit(self.mechanism.effort_limits())

    def prepare(self, changes: Mapping[str, float]) -> PreparedValues:
        """Validate changes of the current values, without applying them; may be called from any thread.

        :raises CommandError: an unknown key, a value that does not fit, or one on which other numbers depend than
            when it was probed.
        """
        for key in changes:
            if key not in self.current:
                raise CommandError(f"'{key}' is not a live value. {self._remedy(key)}")
        wanted = {key: float(value) for key, value in changes.items()}
        try:
            given, current, changed = self._with(wanted)
            dynamics.require_followable_cams(changed)
            inputs = self._symbolic().checked_values_in(dynamics.equation_data(changed))
        except MechanismError as error:
            raise CommandError(
                "; ".join(f"{p.key}: {p.message}. {p.remedy}".strip() for p in error.problems)
            ) from error
        except dynamics.StructureError as error:
            raise CommandError(f"{', '.join(changes)}: {error}. Change the file and start again.") from error
        following = {key: value for key, value in current.items() if value != self.current[key]}
        return PreparedValues({**wanted, **following}, given, current, inputs, changed)

    def _with(self, wanted: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float], Mechanism]:
        """The values that have been given after a change, all values, and the mechanism with them.

        A value that is given as it is already, by its formula, continues to follow it.
        """
        before = self._given_values()
        given = {**before, **wanted}
        changed = with_values(self._mechanism, given)
        current = self._values_in(changed, given)
        repeated = {key for key, value in wanted.items() if key not in before and value == self.current[key]}
        if repeated:
            fewer = {key: value for key, value in given.items() if key not in repeated}
            if (unchanged := self._with_all(fewer, current)) is not None:
                return fewer, current, unchanged
        return given, current, changed

    def _given_values(self) -> Mapping[str, float]:
        """The fewest values from which the current ones follow."""
        if self._given is None:
            given = {key: value for key, value in self.current.items() if value != self._of_file[key]}
            parameters = {key: given[key] for key in given if location_of(self._mechanism, key)[0] == "parameters"}
            following = self._following(parameters)
            fewer = {key: value for key, value in given.items() if key not in following}
            if following and self._with_all(fewer, self.current) is not None:
                given = fewer
            for key in sorted(given, key=lambda key: key in parameters):
                fewer = {other: value for other, value in given.items() if other != key}
                if fewer and self._with_all(fewer, self.current) is not None:
                    given = fewer
            self._given = given
        return self._given

    def _following(self, parameters: Mapping[str, float]) -> set[str]:
        """The keys of other values that are the current ones if only these parameters are given."""
        try:
            values = self._values_in(with_values(self._mechanism, parameters), parameters) if parameters else {}
        except MechanismError:
            return set()
        return {key for key, value in values.items() if key not in parameters and value == self.current[key]}

    def _with_all(self, given: Mapping[str, float], values: Mapping[str, float]) -> Mechanism | None:
        """The mechanism with the given values; None if it is not possible, or does not have all of the `values`."""
        try:
            mechanism = with_values(self._mechanism, given)
        except MechanismError:
            return None
        return mechanism if self._values_in(mechanism, given) == values else None

    def _values_in(self, mechanism: Mechanism, given: Mapping[str, float]) -> dict[str, float]:
        """All live values in the mechanism with the given ones."""
        values = values_of(mechanism, [key for key in self.current if key not in given])
        return {key: given[key] if key in given else values[key] or 0.0 for key in self.current}

    def _symbolic(self) -> SymbolicParameters:
        if self.parameters is not None:
            return self.parameters.symbolic
        return dynamics.varying_parameters(dynamics.equation_data(self._mechanism), ())

    def _remedy(self, key: str) -> str:
        """How a value becomes live, or what the key is meant to be."""
        try:
            value_of(self._mechanism, key)
        except MechanismError as error:
            return nearest(key, self.current) or error.problems[0].remedy
        listed = f"live=['{key}']" if not self.current else f"live=[…, '{key}']"
        return (
            f"To change it during a run, name it at the start: Simulation(..., {listed}), or the parameter `live` "
            "of sim_node."
        )


def require_closed(changes: Mapping[str, float], gap: float, before: float) -> None:
    """Refuse changes that open loops.

    :param gap: the largest violation of the constraints in position with the changes, m or 1.
    :param before: the same without them.
    :raises CommandError: the gap is too large for the next step to close it.
    """
    if gap > max(LARGEST_GAP, 10.0 * before):
        raise CommandError(
            f"{', '.join(changes)}: this would open the loops by {gap:.3g}. Start again with the new value."
        )


class _LiveNumbers(NamedTuple):
    """The live values at the start by key, and `indices`, `columns` and values as in `SymbolicParameters`."""

    current: dict[str, float]
    indices: NDArray[np.intp]
    columns: NDArray[np.intp]
    values: Array


def _found(mechanism: Mechanism, names: Sequence[str]) -> _LiveNumbers:
    """The live values of these names, from the cache if they were searched for before: see `LiveValues`."""
    if mechanism.source.changed:
        return _searched(mechanism, names)
    return cached(lambda: _searched(mechanism, names), "live values", records_digest(mechanism), *names)


def _searched(mechanism: Mechanism, names: Sequence[str]) -> _LiveNumbers:
    base = dynamics.equation_data(mechanism)
    keys = [(key, "*" in name) for name in names for key in (matching(mechanism, [name]) if "*" in name else [name])]
    values = values_of(mechanism, [key for key, _ in keys])
    found: dict[str, EquationData] = {}
    problems: list[Problem] = []
    for key, is_match in keys:
        try:
            found[key] = _probed(mechanism, key, values[key], base)
        except dynamics.StructureError as error:
            if not is_match:
                remedy = "Change the file and start again."
                problems.append(Problem(f"cannot change during a run: {error}", remedy, key=key))
    if problems:
        raise MechanismError(problems)
    parameters = dynamics.varying_parameters(base, list(found.values()))
    current = {key: values[key] or 0.0 for key in found}
    return _LiveNumbers(current, parameters.indices, parameters.columns, parameters.base)


def _probed(mechanism: Mechanism, key: str, value: float | None, base: EquationData) -> EquationData:
    """The numbers of the mechanism with another value at a key than the present one.

    :raises StructureError: the value is not a number, is built into the equations, or is not used by them.
    """
    if value is None:
        raise dynamics.StructureError("it is not a number")
    probes = [factor * value for factor in _PROBE_FACTORS] if value else list(_PROBES_OF_ZERO)
    refusal = None
    for probe in probes:
        try:
            numbers = dynamics.equation_data(with_values(mechanism, {key: probe}))
        except MechanismError as error:
            refusal = error
            continue
        if not len(dynamics.varying_parameters(base, [numbers]).base):
            raise dynamics.StructureError("the equations of motion do not depend on it")
        return numbers
    assert refusal is not None
    raise dynamics.StructureError(f"no value near {value:g} is possible: {refusal.problems[0].message}") from refusal
