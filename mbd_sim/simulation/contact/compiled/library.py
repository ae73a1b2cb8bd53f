"""The compiled functions, which take addresses in place of arrays and records."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from mbd_sim.compiler.code.host_module import compile_once, new_module
from mbd_sim.compiler.ir.python_functions import emit_function
from mbd_sim.compiler.ir.python_kinds import name_of, prototype, signature_of
from mbd_sim.simulation.contact.compiled import (
    collocation,
    lengths,
    members,
    nodes,
    pairs,
    search,
    slip,
    step,
    time_stepping,
    touching,
    trial,
)
from mbd_sim.simulation.contact.compiled.features import (
    barrels,
    clusters,
    outlines,
    pieces,
    polytope_distances,
    polytopes,
    vectors,
)
from mbd_sim.simulation.contact.compiled.features.round import (
    bodies,
    crossings,
    flat_rims,
    meetings,
    normals,
    rims,
    rounded_edges,
    slots,
    smooth,
    smooth_distances,
)
from mbd_sim.simulation.contact.compiled.instant import (
    candidate_forces,
    contacts,
    forces,
    impact,
    islands,
    least_forces,
    linear,
    modes,
    shared_forces,
    sliding,
)
from mbd_sim.simulation.contact.compiled.together import (
    elimination,
    step_forces,
    step_impulses,
    step_modes,
)

MODULES: tuple[ModuleType, ...] = (
    barrels,
    bodies,
    candidate_forces,
    clusters,
    collocation,
    contacts,
    crossings,
    elimination,
    flat_rims,
    forces,
    impact,
    islands,
    least_forces,
    lengths,
    linear,
    meetings,
    members,
    modes,
    nodes,
    normals,
    outlines,
    pairs,
    pieces,
    polytope_distances,
    polytopes,
    rims,
    rounded_edges,
    search,
    shared_forces,
    sliding,
    slip,
    slots,
    smooth,
    smooth_distances,
    step,
    step_forces,
    step_impulses,
    step_modes,
    time_stepping,
    touching,
    trial,
    vectors,
)
EXPORTED: tuple[Callable[..., Any], ...] = (
    members.advance_members,
    step.advance,
    time_stepping.advance_by_time_stepping,
    touching.end_step,
    touching.renew,
    islands.find_islands,
    islands.unique_forces,
    islands.settled_forces,
    step_forces.nearest_forces,
    forces.residual_of,
    forces.newton,
    forces.by_lemke,
    forces.sweep,
    shared_forces.elastic_forces,
    least_forces.share,
    linear.product,
    linear.solve,
    linear.null_space,
    linear.least,
    linear.least_solution,
    linear.pivots,
    linear.unit_diagonal,
    linear.best_conditioned,
    linear.independent,
    linear.lemke,
    barrels.barrel_distance,
    barrels.barrel_margin,
    barrels.barrel_touching,
    clusters.cluster_distance,
    clusters.cluster_margin,
    clusters.cluster_touching,
    outlines.outline_distance,
    outlines.outline_margin,
    outlines.outline_touching,
    pieces.depth_of,
    pieces.lower_bound,
    pieces.meet_pieces,
    polytope_distances.polytope_distance,
    polytopes.polytope_margin,
    polytopes.polytope_touching,
    smooth_distances.smooth_beyond,
    smooth_distances.smooth_distance,
    smooth.smooth_margin,
    smooth.smooth_renew,
    smooth.smooth_touching,
)


@functools.cache
def library() -> SimpleNamespace:
    """The compiled functions, which release the interpreter's lock, and their `addresses` by name."""
    code = compile_once([*_contents()], _emitted)
    addresses = {one.__name__: code.address(name_of(one)) for one in EXPORTED}
    names = {one.__name__: prototype(*signature_of(one))(addresses[one.__name__]) for one in EXPORTED}
    return SimpleNamespace(code=code, addresses=addresses, **names)


def called(name: str, *arguments: Any) -> Any:
    """The result of a compiled function that is given arrays; what it changes must be contiguous."""
    arrays = [np.ascontiguousarray(one) if isinstance(one, np.ndarray) else one for one in arguments]
    given = [one.ctypes.data if isinstance(one, np.ndarray) else one for one in arrays]
    return getattr(library(), name)(*given)


def _emitted() -> str:
    module = new_module()
    for function in EXPORTED:
        emit_function(module, function, exported=True)
    return str(module)


def _contents() -> Iterator[str]:
    """What the code is made from: the functions, with their modules, and all constants."""
    yield from map(name_of, EXPORTED)
    sources = {f"mbd_sim.compiler.ir.{name}" for name in ("python_functions", "python_kinds", "builder", "module")}
    for module in MODULES:
        for name, value in sorted(vars(module).items()):
            if isinstance(value, (int, float)):
                yield f"{module.__name__}.{name} = {value!r}"
            elif inspect.isfunction(value):
                yield f"{module.__name__}.{name}: {name_of(value)}"
                sources.add(value.__module__)
    for source in sorted(sources):
        yield inspect.getsource(sys.modules[source])
