"""The steps of exported methods as C text, from the emitters of the kernel."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, integer
from mbd_sim.compiler.ir.module import BOOL, POINTER, VOID, Function, FunctionType, Value
from mbd_sim.compiler.kernel import StepNeeds, step_of
from mbd_sim.compiler.lists.instruction_list import Instructions
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.steps.emitter import ChangesBetweenSteps, StepEmitter, System
from mbd_sim.exports.c_code.builder import CBuilder, CModule
from mbd_sim.exports.c_code.functions import c_function
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.integrators.method import Method

PROJECTION = """\
static void project_in_place(double t, double *y, const double *in)
{
    double projected[SIZE];

    projection(t, y, in, projected);
    memcpy(y, projected, sizeof projected);
}"""


def step_functions(model: ExportedModel) -> list[str]:
    """The texts of rates and projection, and of `static void step_METHOD(…)` for each method, with what it calls."""
    equations = model.equations
    module = CModule(len(model.states))
    program, margin = arranged(equations.rates), ["margin"] * (equations.rates.n_out() > 1)
    rates = _listed(module, program, "rates", ("t", "y", "in"), ("out", *margin))
    module.texts[-1] = f"/* y' of the equations of motion. */\n{module.texts[-1]}"
    projection = None
    if equations.project is not None:
        _listed(module, arranged(equations.project, fused=False), "projection", ("t", "y", "in"), ("out",))
        module.texts.append(PROJECTION)
        module.unchanged["project_in_place"] = frozenset({2})
        projection = Function(module, FunctionType(VOID, [DOUBLE, POINTER, POINTER]), "project_in_place")
    between = model.between_steps
    system = System(
        size=len(model.states),
        error_size=equations.core.stop,
        rates=rates,
        projection=projection,
        reports_conditioning=bool(margin),
        projection_takes_inputs=True,
        projects_in_place=True,
        held=frozenset() if between is None else between.held,
        inputs_size=equations.inputs.size,
        instructions=instruction_count(program),
        scales=equations.scales,
    )
    sample = _sample(module, model)
    for method in model.methods:
        _step(module, system, model, method, sample)
    return module.texts


def _listed(
    module: CModule, function: Instructions, name: str, arguments: Sequence[str], results: Sequence[str]
) -> Function:
    """A function of an instruction list, whose arguments t and g are numbers."""
    module.texts.append(c_function(function, name, arguments, results, ("t", "g")))
    types = [DOUBLE if argument in ("t", "g") else POINTER for argument in arguments]
    module.unchanged[name] = frozenset(range(len(arguments)))
    return Function(module, FunctionType(VOID, [*types, *[POINTER] * len(results)]), name)


def _sample(module: CModule, model: ExportedModel) -> Function | None:
    """`static void sample(int64_t index, double t, double *y, const double *in)`: what changes before a step."""
    if (between := model.between_steps) is None:
        return None
    sampled = [
        (sampler, _listed(module, sampler.function, f"sampled_{number}", ("t", "y", "in"), ("out",)))
        for number, sampler in enumerate(between.samplers)
    ]
    samples = ChangesBetweenSteps(between.delays, sampled)
    types = [INT, DOUBLE, POINTER, POINTER]
    function = Function(module, FunctionType(VOID, types), "sample", ("index", "t", "y", "in"))
    function.about = "Delayed commands move on, and sampled controllers act."
    index, *arguments = function.args
    b = CBuilder(function.append_basic_block("entry"))
    samples.emit(b, index, arguments, samples.results(b))
    b.ret_void()
    return function


def _step(module: CModule, system: System, model: ExportedModel, method: Method, sample: Function | None) -> None:
    equations = model.equations

    def emit(function: ca.Function, arguments: Sequence[str], results: Sequence[str]) -> Function:
        return _listed(module, function, function.name(), arguments, results)

    types = [INT, DOUBLE, DOUBLE, DOUBLE, POINTER, POINTER, POINTER]
    names = ("index", "t", "t_next", "h", "y", "in", "history")
    function = Function(module, FunctionType(VOID, types), f"step_{method.name}", names)
    function.about = f"A step of {method.name}, order {method.order}, from the time t to t_next = t + h."
    index, t, t_next, h, y, inputs, history = function.args
    b = CBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, h, y, estimates=False)
    emitter.index, emitter.steps, emitter.history = index, integer(1), history
    needs = StepNeeds(equations.rates, equations.core, lambda: equations.joint_linearization.partial_system, emit)
    step = step_of(method, needs)(emitter)
    if emitter.begin is not None:
        emitter.begin()
    if sample is not None:
        b.call(sample, [index, t, y, inputs])
    step(t)
    emitter.project(t_next, y)
    emitter.index = b.add(index, integer(1))
    if emitter.end is not None:
        emitter.end(Value(BOOL, "true"))
    b.ret_void()
