"""A step of a Gauss method, as IR: sweeps over the stages until nothing changes, never more than a given number."""

from __future__ import annotations

import llvmlite.ir as ir

from mbd_sim.compiler.ir_types import (
    DOUBLE,
    INT,
    integer,
    number,
)
from mbd_sim.compiler.ir_vectors import (
    Index,
    add_squares,
    combine,
    copy,
    each,
    load,
    store,
    weighted,
)
from mbd_sim.compiler.stepping import Frame, Prepare, Step
from mbd_sim.integrators.gauss import Gauss

NOTHING = 1e-17  # change of the scaled state below which a sweep has found nothing new
SETTLING = 3  # sweeps after which a change that no longer falls is round-off


def gauss_step(method: Gauss) -> Prepare:
    """The step of a Gauss method, for `emit_advance`."""

    def prepare(frame: Frame) -> Step:
        b, size = frame.b, frame.system.size
        start, fresh, trial = frame.vector(), frame.vector(), frame.vector()
        k = [frame.vector() for _ in range(method.stages)]
        change, before = frame.scalar(), frame.scalar()
        estimate = frame.estimator(method.estimate, [start, *k])

        def sweep(t: ir.Value) -> None:
            """Each stage from the newest of the others; `change` is how far they moved, squared."""
            b.store(number(0.0), change)
            for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
                moment, slopes = frame.later(t, c), k[stage]
                combine(b, size, trial, frame.y, frame.h, weighted(weights, k))
                frame.settle_stage(moment, trial)
                frame.rates(moment, trial, fresh)

                def component(i: Index, slopes: ir.Value = slopes) -> None:
                    moved = b.fmul(frame.h, b.fsub(load(b, fresh, i), load(b, slopes, i)))
                    add_squares(b, change, b.fmul(moved, frame.scale(i)))
                    store(b, load(b, fresh, i), slopes, i)

                each(b, size, component)

        def step(t: ir.Value) -> None:
            frame.rates(t, frame.y, start, first=True)
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
            useful = b.fcmp_ordered(">", moved, number(NOTHING**2))
            falling = b.fcmp_ordered("<", moved, b.load(before, typ=DOUBLE))
            early = b.icmp_signed("<=", count, integer(SETTLING))
            more = b.and_(b.and_(useful, b.or_(falling, early)), b.icmp_signed("<", count, integer(method.sweeps)))
            count.add_incoming(b.add(count, integer(1)), b.block)
            b.cbranch(more, again, done)
            b.position_at_end(done)
            estimate(frame.h, frame.root(b.load(change, typ=DOUBLE)))
            combine(b, size, frame.y, frame.y, frame.h, weighted(method.b, k))

        return step

    return prepare
