"""Live values: numbers of a mechanism file that change during a run, without another kernel.

The numbers of the equations that depend on a named value of the file are found by changing this value.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.disk_cache import cached, records_digest
from mbd_sim.base.errors import CommandError, InputError, MechanismError, Problem, nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.override import location_of, matching, number_at, value_of, values_of, with_values
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Location, value_at
from mbd_sim.simulation.model.commands import EffortMap, by_name

if TYPE_CHECKING:
    from mbd_sim.dynamics.kinematics.parameters import EquationData, SymbolicParameters
    from mbd_sim.files.text.parameters import Parameters


_PROBE_FACTORS = (1.01, 0.99)  # applied to a value to find the numbers that depend on it
_PROBES_OF_ZERO = (1e-3, -1e-3, 1e-9, -1e-9)  # the latter where ranges are narrow, as in µm


@dataclass(frozen=True, slots=True)
class LiveNumbers:
    """The live values at the start by key, and `indices`, `columns` and values as in `SymbolicParameters`."""

    current: dict[str, float]
    indices: NDArray[np.intp]
    columns: NDArray[np.intp]
    values: Array


def live_numbers(mechanism: Mechanism, names: Sequence[str]) -> LiveNumbers:
    """The live values of these names, from the cache if they were searched for before: see `LiveValues`.

    :raises MechanismError: a name does not exist or cannot change, or a pattern matches nothing.
    """
    if mechanism.source.changed:
        return _searched(mechanism, names)
    return cached(lambda: _searched(mechanism, names), "live values", records_digest(mechanism), *names)


def _searched(mechanism: Mechanism, names: Sequence[str]) -> LiveNumbers:
    from mbd_sim.dynamics.kinematics.parameters import StructureError, equation_data, varying_parameters

    base, file = equation_data(mechanism), mechanism.source.file
    matches = {name: _matches(mechanism, name) for name in names}
    problems = [
        Problem("no number of the file has such a key", nearest(name, matching(mechanism, ["*"])), name, file=file)
        for name, found in matches.items()
        if not found
    ]
    keys = _each_once(mechanism, [key for found in matches.values() for key in found])
    values = values_of(mechanism, keys)
    given = {_location(mechanism, name) for name in names if "*" not in name}
    numbers: dict[str, EquationData] = {}
    for key in keys:
        try:
            numbers[key] = _probed(mechanism, key, values[key], base)
        except StructureError as error:
            if _location(mechanism, key) in given:
                remedy = _remedy_of_list(mechanism, key) or "Change the file and start again."
                problems.append(Problem(f"cannot change during a run: {error}", remedy, key, file=file))
    if problems:
        raise MechanismError(problems)
    parameters = varying_parameters(base, list(numbers.values()))
    current = {key: values[key] or 0.0 for key in numbers}
    return LiveNumbers(current, parameters.indices, parameters.columns, parameters.base)


def names_with_matches(mechanism: Mechanism, names: Sequence[str]) -> list[str]:
    """The names without those patterns that no number of the file matches; from the cache if known."""

    def search() -> list[str]:
        return [name for name in names if _matches(mechanism, name)]

    if mechanism.source.changed:
        return search()
    return cached(search, "live names", records_digest(mechanism), *names)


def _matches(mechanism: Mechanism, name: str) -> list[str]:
    return matching(mechanism, [name]) if "*" in name else [name]


def _each_once(mechanism: Mechanism, keys: Iterable[str]) -> list[str]:
    """The keys without those that name the same value by another name: `l` and `parameters.l`."""
    first: dict[object, str] = {}
    for key in keys:
        first.setdefault(_location(mechanism, key), key)
    return list(first.values())


def _location(mechanism: Mechanism, key: str) -> object:
    """Where a value is, or the key of one that does not exist: its problem is reported with its value."""
    try:
        return location_of(mechanism, key)
    except MechanismError:
        return key


def _remedy_of_list(mechanism: Mechanism, key: str) -> str:
    """What to name in place of a list of numbers; empty if the key is none."""
    if not matching(mechanism, [f"{key}[*]"]):
        return ""
    return f"Name one of its numbers, such as '{key}[0]', or '{key}[*]' for all of them."


def _probed(mechanism: Mechanism, key: str, value: float | None, base: EquationData) -> EquationData:
    """The numbers of the mechanism with another value at a key than the present one.

    :raises StructureError: the value is not a number, is built into the equations, or is not used by them.
    """
    from mbd_sim.dynamics.kinematics.parameters import StructureError, equation_data, varying_parameters

    if value is None:
        raise StructureError("it is not a number")
    probes = [factor * value for factor in _PROBE_FACTORS] if value else list(_PROBES_OF_ZERO)
    refusal = None
    for probe in probes:
        try:
            numbers = equation_data(with_values(mechanism, {key: probe}))
        except MechanismError as error:
            refusal = error
            continue
        if not len(varying_parameters(base, [numbers]).base):
            raise StructureError("the equations of motion do not depend on it")
        return numbers
    assert refusal is not None
    raise StructureError(f"no value near {value:g} is possible: {refusal.problems[0].message}") from refusal


LARGEST_GAP = 1e-6  # of the natural length, or 1: the violation of constraints that a change of live values may leave


@dataclass(frozen=True, slots=True)
class PreparedValues:
    """Validated changes of live values: the changes, all live values after them, and the values (n,) in the inputs.

    The changes include those of values that follow the given ones. `given` are all values that have been given, from
    which the others follow; `mechanism` is the one with these values. With `reassemble`, a mechanism whose
    loops they would open is assembled anew.
    """

    changes: Mapping[str, float]
    given: Mapping[str, float]
    current: Mapping[str, float]
    inputs: Array
    mechanism: Mechanism
    reassemble: bool = False


class LiveParameters:
    """The numbers of a mechanism's equations that depend on live values, as symbols when equations are traced."""

    def __init__(self, mechanism: Mechanism, indices: NDArray[np.intp], columns: NDArray[np.intp], base: Array) -> None:
        """`indices`, `columns` and `base` are those of `SymbolicParameters`."""
        self._mechanism, self._numbers = mechanism, (indices, columns, base)

    def __reduce__(self) -> tuple[object, ...]:
        return LiveParameters, (self._mechanism, *self._numbers)

    @property
    def digest(self) -> str:
        """Equal for the same numbers of the same mechanism."""
        return hashlib.sha256(b" ".join(array.tobytes() for array in self._numbers)).hexdigest()

    @cached_property
    def symbolic(self) -> SymbolicParameters:
        """The symbols, which need CasADi."""
        from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters, equation_data

        return SymbolicParameters(equation_data(self._mechanism), *self._numbers)


class LiveValues:
    """The live values of a mechanism by their keys in its file, see `with_values`; `current` are in SI units.

    A value that has not been given itself follows the others, as its formula in the file says: after
    `damping: 2*d`, it changes with the parameter d.
    """

    def __init__(self, mechanism: Mechanism, names: Sequence[str]) -> None:
        """Find the numbers of the equations that depend on the named values: the `parameters`, None without names.

        :param names: keys, or patterns such as `joints.*.damping`, which stand for those matches that can be live.
        :raises MechanismError: a key does not exist, its value is built into the equations, or no number of the file
            matches a pattern.
        """
        self._mechanism = mechanism
        self.current: dict[str, float] = {}
        self.parameters: LiveParameters | None = None
        if names:
            found = live_numbers(mechanism, names)
            self.current = found.current
            self.parameters = LiveParameters(mechanism, found.indices, found.columns, found.values)
        self._of_file = self.current
        self._given: Mapping[str, float] | None = {}  # None: not known, but found in `current` when needed
        self._changed, self._changed_with = mechanism, self.current

    def copy(self) -> LiveValues:
        """A copy whose values change independently."""
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

    def prepare(self, changes: Mapping[str, float | str]) -> PreparedValues:
        """Validate changes of the current values, without applying them; may be called from any thread.

        :param changes: numbers in SI units, or texts with units such as `"30 deg"`.
        :raises CommandError: an unknown key, a value that does not fit, or one on which other numbers depend than
            when it was probed.
        """
        from mbd_sim.dynamics.contact.cams import require_followable_cams
        from mbd_sim.dynamics.kinematics.parameters import StructureError, equation_data

        wanted: dict[str, float] = {}
        for name, value in by_name(changes, "live values").items():
            key = self._key(name)
            if key in wanted:
                raise CommandError(f"'{key}' is given twice", "Remove one of the two.")
            wanted[key] = self._number(key, value)
        try:
            given, current, changed = self._with(wanted)
            require_followable_cams(changed)
            inputs = self._symbolic().checked_values_in(equation_data(changed))
        except MechanismError as error:
            raise CommandError(" ".join(f"{p.key}: {p.message}. {p.remedy}".strip() for p in error.problems)) from error
        except StructureError as error:
            raise CommandError(f"{', '.join(changes)}: {error}", "Change the file and start again.") from error
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
            self._given = self._fewest()
        return self._given

    def _fewest(self) -> dict[str, float]:
        """The current values other than those that the file gives with the others at their current values."""
        by_location = {location_of(self._mechanism, key): key for key in self.current}
        written, parameters = self._mechanism.source.data, self._parameters()

        def follows(location: Location, key: str) -> bool:
            text = value_at(written, location)
            if not isinstance(text, str):
                return self.current[key] == self._of_file[key]
            try:
                return self.current[key] == parse_value(text, parameters.values, None, parameters.functions.expanded)
            except InputError:  # the formula is not defined with the others at their current values
                return False

        given = {
            key: self.current[key]
            for location, key in by_location.items()
            if location[0] == "parameters" and not follows(location, key)
        }
        try:
            values = self._values_in(with_values(self._mechanism, given), given) if given else self._of_file
        except MechanismError:  # these values are possible only with others
            return {key: self.current[key] for location, key in by_location.items() if not follows(location, key)}
        return {key: value for key, value in self.current.items() if key in given or values[key] != value}

    def _parameters(self) -> Parameters:
        """The file's parameters with the current values, and its functions."""
        # Imported here because its modules take a twentieth of the time of a start.
        from mbd_sim.files.text.parameters import resolve_parameters

        source = self._mechanism.source
        locations = {location_of(self._mechanism, key): value for key, value in self.current.items()}
        live = {location[1]: value for location, value in locations.items() if location[0] == "parameters"}
        data = {**source.data, "parameters": {**(source.data.get("parameters") or {}), **live}}
        return resolve_parameters(replace(source, data=data))

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
        from mbd_sim.dynamics.kinematics.parameters import equation_data, varying_parameters

        if self.parameters is not None:
            return self.parameters.symbolic
        return varying_parameters(equation_data(self._mechanism), ())

    def _key(self, name: str) -> str:
        """The key of a live value by any of its names: that of a parameter may also be `parameters.` and this name.

        :raises CommandError: there is none.
        """
        if name in self.current:
            return name
        try:
            location = location_of(self._mechanism, name)
        except MechanismError:
            location = ()
        for key in self.current:
            if location and location_of(self._mechanism, key) == location:
                return key
        raise CommandError(f"'{name}' is not a live value", self._remedy(name))

    def _number(self, key: str, value: object) -> float:
        """A given value in SI units.

        :raises CommandError: it is not a number, or has a unit that does not fit.
        """
        value = value.tolist() if hasattr(value, "tolist") else value  # a number of NumPy
        try:
            return number_at(self._mechanism, key, value, {})
        except InputError as error:
            raise CommandError(f"{key}: {error.message} (got {quoted(value)})", error.remedy) from error

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


def opens_loops(gap: float, before: float, length: float) -> bool:
    """Whether a change of live values opens loops too far for the next step to close them.

    :param gap: the largest violation of the constraints in position with the change, m or 1.
    :param before: the same without it.
    :param length: the natural length in m.
    """
    return gap > max(LARGEST_GAP * length, 10.0 * before)
