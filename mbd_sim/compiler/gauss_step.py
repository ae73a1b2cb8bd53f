"""A step of a Gauss method, as IR: sweeps over the stages until nothing changes, up to a given number."""

from __future__ import annotations

from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    integer,
    number,
)
from mbd_sim.compiler.ir_vectors import (
    Index,
    add_square,
    combine,
    copy,
    for_each,
    load,
    store,
    weighted,
)
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.gauss import Gauss

CONVERGED = 1e-17  # change of the scaled state below which the sweeps have converged
FIRST_SWEEPS = 3  # after these, a change that no longer falls is round-off


def gauss_step(method: Gauss) -> Prepare:
    """The step of a Gauss method, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        b, size = emitter.b, emitter.system.size
        start, fresh, trial = emitter.vector(), emitter.vector(), emitter.vector()
        k = [emitter.vector() for _ in range(method.stages)]
        change, before = emitter.scalar(), emitter.scalar()
        emit_estimate = emitter.estimator(method.estimate, [start, *k])

        def sweep(t: Value) -> None:
            """Compute each stage from the newest slopes of the others; `change` is the squared norm of the change."""
            b.store(number(0.0), change)
            for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
                stage_time, slopes = emitter.stage_time(t, c), k[stage]
                combine(b, size, trial, emitter.y, emitter.h, weighted(weights, k))
                emitter.project_stage(stage_time, trial)
                emitter.rates(stage_time, trial, fresh)

                def component(i: Index, slopes: Value = slopes) -> None:
                    moved = b.fmul(emitter.h, b.fsub(load(b, fresh, i), load(b, slopes, i)))
                    add_square(b, change, b.fmul(moved, emitter.scale(i)))
                    store(b, load(b, fresh, i), slopes, i)

                for_each(b, size, component)

        def step(t: Value) -> None:
            emitter.rates(t, emitter.y, start, first=True)
            for slopes in k:
                copy(b, size, start, slopes)
            b.store(number(0.0), change)
            entry, again, done = b.block, b.append_basic_block("sweep"), b.append_basic_block("swept")
            b.branch(again)
            b.position_at_end(again)
            count = b.phi(INT)
            count.add_incoming(integer(1), entry)
            b.store(b.load(change, typ=DOUBLE), before)
            sweep(t)
            moved = b.load(change, typ=DOUBLE)
            not_converged = b.fcmp_ordered(">", moved, number(CONVERGED**2))
            falling = b.fcmp_ordered("<", moved, b.load(before, typ=DOUBLE))
            early = b.icmp_signed("<=", count, integer(FIRST_SWEEPS))
            allowed = b.or_(falling, early)
            more = b.and_(b.and_(not_converged, allowed), b.icmp_signed("<", count, integer(method.sweeps)))
            count.add_incoming(b.add(count, integer(1)), b.block)
            b.cbranch(more, again, done)
            b.position_at_end(done)
            emit_estimate(emitter.h, emitter.square_root(b.load(change, typ=DOUBLE)))
            combine(b, size, emitter.y, emitter.y, emitter.h, weighted(method.b, k))

        return step

    return prepare
