"""The tests of a process share what they build: shipped mechanisms are read once, equal ones derived and compiled once.

`Mechanism`, `Equations`, `LagrangeEquations`, `Model` and `SymbolicEquations` have no state, so that sharing changes nothing but the time.
What cannot be pickled is built each time. The fixture `own_builds` turns sharing off.
"""

import functools
import pickle
import sys
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import mbd_sim.dynamics.equations
import mbd_sim.dynamics.lagrange
import mbd_sim.files.load
import mbd_sim.simulation.model.model
from mbd_sim.compiler.code import machine_code
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
from mbd_sim.files.text.library import shipped
from mbd_sim.simulation.model.live_values import LiveParameters
from mbd_sim.studies.symbolic import symbolic_equations

MOST = 380  # mechanisms, models and equations that are kept; those not used for longest go
BUILDERS = (
    mbd_sim.files.load.load_mechanism,
    mbd_sim.dynamics.equations.derive,
    mbd_sim.dynamics.lagrange.lagrange_equations,
    mbd_sim.simulation.model.model.build_model,
    symbolic_equations,
)

SHIPPED = frozenset(shipped())

enabled = True
_kept: OrderedDict[bytes, Any] = OrderedDict()


def share_builds() -> None:
    """Replace the builders in all modules of the package; modules that are imported later find the replacements."""
    for builder in BUILDERS:
        sharing = _sharing(builder)
        for name, module in list(sys.modules.items()):
            if name.partition(".")[0] == "mbd_sim" and vars(module).get(builder.__name__) is builder:
                setattr(module, builder.__name__, sharing)


def _sharing(builder: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(builder)
    def build(*given: Any, **named: Any) -> Any:
        key = _key(builder.__name__, given, named) if enabled else None
        if key is None:
            return builder(*given, **named)
        if key not in _kept:
            _kept[key] = builder(*given, **named)
            if len(_kept) > MOST:
                _kept.popitem(last=False)
        _kept.move_to_end(key)
        return _kept[key]

    return build


def _key(name: str, given: tuple[Any, ...], named: dict[str, Any]) -> bytes | None:
    """What a result depends on, or None where that cannot be written down."""
    if name == "load_mechanism" and (named or given[0] not in SHIPPED):
        return None  # a file, which may change
    contents = [_content(value) for value in (*given, *named.values())]
    try:
        level = machine_code.LEVEL if name == "build_model" else None
        return pickle.dumps((name, contents, sorted(named), level))
    except Exception:  # pickle raises whatever the objects raise
        return None


def _content(value: Any) -> Any:
    """A value as the key holds it: of symbolic and live parameters, which numbers they stand for."""
    if isinstance(value, LiveParameters):
        return value.digest
    if isinstance(value, SymbolicParameters):
        return value.indices.tobytes(), value.columns.tobytes(), value.base.tobytes()
    return value
