"""A step of an explicit Runge–Kutta method, as IR."""

from __future__ import annotations

from mbd_sim.compiler.ir import Value
from mbd_sim.compiler.ir_vectors import combine, combine_at_once, load, store, weighted
from mbd_sim.compiler.step_emitter import EmitStep, Prepare, StepEmitter
from mbd_sim.integrators.tableau import Tableau


def explicit_step(method: Tableau) -> Prepare:
    """The step of a tableau, for `emit_advance`."""

    def prepare(emitter: StepEmitter) -> EmitStep:
        k, trial = [emitter.vector() for _ in range(method.stages)], emitter.vector()
        emit_estimate = emitter.estimator(method.estimate, k)
        system, size, y = emitter.system, emitter.system.size, emitter.y
        still, unread = system.still | system.held, system.unread | system.held

        def step(t: Value) -> None:
            for index in sorted(system.held - system.unread):
                store(emitter.b, load(emitter.b, y, index), trial, index)
            for stage, (weights, c) in enumerate(zip(method.a, method.c, strict=True)):
                stage_time, state = emitter.stage_time(t, c), y
                if any(weights):
                    state = trial
                    combine_at_once(
                        emitter.b, size, trial, y, emitter.h, weighted(weights, k), still=still, unread=unread
                    )
                    emitter.project_stage(stage_time, trial)
                emitter.rates(stage_time, state, k[stage], first=stage == 0)
            emit_estimate(emitter.h)
            combine(emitter.b, size, y, y, emitter.h, weighted(method.b, k), still=still)

        return step

    return prepare
