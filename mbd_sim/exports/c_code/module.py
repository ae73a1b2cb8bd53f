"""An exported model as a C99 module: a header with its structures and functions, and a source without dependencies.

The parts of a C module that are the same for all mechanisms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbd_sim import __version__
from mbd_sim.exports.c_code.assembly import ASSEMBLY_DECLARATION, assembly_functions
from mbd_sim.exports.c_code.builder import step_functions
from mbd_sim.exports.c_code.functions import c_function, literal, sine_cosine_text
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.exports.c_code.variables import Variable
from mbd_sim.integrators.method import Method

FLAGS = "-std=c99 -O3 -march=native -ffp-contract=off -fno-math-errno"

HEADER = """\
/*
 * {name}: the equations of motion of the mechanism '{mechanism}' and steps of them.
 * {description}
 *
 * SPDX-License-Identifier: Apache-2.0
 * Made by mbd_sim {version} from the file with the SHA-256 hash
 * {hash}{changes}.
 * Make it again rather than edit it. SI units: m, rad, s, kg, N, N.m, J.
 *
 * C99 without libraries other than that of mathematics (link with -lm); no memory is allocated, and nothing is global
 * but functions. A processor with fused multiply-adds needs the flag for them, or calls a slow function instead.
 * The compiler must neither reassociate nor contract, so do not use -ffast-math. With
 *     {flags}
 * gcc gets the same bits as the simulation, up to the functions exp, log, tan, asin, acos, atan, atan2, tanh and pow of
 * the C library, which expressions and friction may use, and sin and cos of angles beyond a million rad.
 */
"""

DECLARATIONS = """
#define {NAME}_STEP {step} /* s, the step size of the file */

{structures}

/* Set the values at the start: assembled positions and speeds, no efforts, the file's commands and parameters. */
void {name}_start({name}_state *state, {name}_inputs *inputs, {name}_parameters *parameters);

/* The rates of the state at the time t in s. */
void {name}_rates(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, {name}_state *rates);

/* Move a state back to the constraints, and quaternions to unit length, as each step does at its end. */
void {name}_project(double t, {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters);

/* Compute the outputs of a state. */
void {name}_output(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, {name}_outputs *outputs);

{steps}

/*
 * A step of {method} between times t and t_next = t + h of a clock of your own; the number of the step counts only for
 * sampled controllers and delayed commands.
 */
int {name}_step_between({name}_state *state, {history}const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double t, double t_next, double h);
"""

STEP_COMMENT = """\
/*
 * A step of size h in s, from the time index * h to (index + 1) * h. Returns 1; or 0 if the state would not stay
 * finite, and then nothing is changed. The first step of a run has the index 0.
 */
"""

STEP_DECLARATION = """\
int {name}_step_{method}({name}_state *state, {history}const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double h);"""

SIZES = """\
/*
 * Within this file, y[], in[], p[] and out[] are the fields of the structures in their order; in[] are the inputs and,
 * from in[{inputs}] on, the numbers of the equations that depend on the parameters.
 */
#define SIZE {size}
#define GIVEN {given}
"""

DEFINITIONS = """\
/* The structures contain doubles and nothing else: if one of these lines does not compile, they have gaps. */
typedef char state_has_no_gaps[sizeof({name}_state) == SIZE * sizeof(double) ? 1 : -1];
typedef char inputs_have_no_gaps[sizeof({name}_inputs) == {input_size} * sizeof(double) ? 1 : -1];
typedef char parameters_have_no_gaps[sizeof({name}_parameters) == {parameter_size} * sizeof(double) ? 1 : -1];
typedef char outputs_have_no_gaps[sizeof({name}_outputs) == {output_size} * sizeof(double) ? 1 : -1];

static void collect(const {name}_inputs *inputs, const {name}_parameters *parameters, double *in, double *p)
{{
    memcpy(in, inputs, {inputs} * sizeof(double));
    memcpy(p, parameters, sizeof *parameters);
    values(p, in + {inputs});
}}

typedef void step_function(
    int64_t index, double t, double t_next, double h, double *y, const double *in, double *history);

static int take(step_function *step, {name}_state *state, void *history, const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double t, double t_next, double h)
{{
    double y[SIZE], in[GIVEN], p[{parameter_size}], zero = 0.0;
    int i;

    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
    step(index, t, t_next, h, y, in, history);
    for (i = 0; i < SIZE; i++)
        zero += 0.0 * y[i];
    if (!(zero == 0.0))
        return 0;
    memcpy(state, y, sizeof y);
    return 1;
}}

void {name}_start({name}_state *state, {name}_inputs *inputs, {name}_parameters *parameters)
{{
{start}
}}

void {name}_rates(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, {name}_state *out)
{{
    double y[SIZE], slopes[SIZE], in[GIVEN], p[{parameter_size}];
{declared_margin}
    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
    rates(t, y, in, slopes{margin});
    memcpy(out, slopes, sizeof slopes);
}}

void {name}_project(double t, {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters)
{{
    double y[SIZE], in[GIVEN], p[{parameter_size}];

    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
{project}
    memcpy(state, y, sizeof y);
}}

void {name}_output(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, {name}_outputs *outputs)
{{
    double y[SIZE], in[GIVEN], p[{parameter_size}], out[{output_size}];

    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
    outputs_of(t, y, in, p, out);
    memcpy(outputs, out, sizeof out);
}}

int {name}_step_between({name}_state *state, {history}const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double t, double t_next, double h)
{{
    return take(step_{method}, state, {memory}, inputs, parameters, index, t, t_next, h);
}}"""

PUBLIC_STEP = """\
int {name}_step_{method}({name}_state *state, {history}const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double h)
{{
    double t = (double)index * h, t_next = (double)(index + 1) * h;

    return take(step_{method}, state, {memory}, inputs, parameters, index, t, t_next, h);
}}"""

HISTORY = """\
/*
 * The slopes of earlier steps, for {method}: set it to zero before the first step, and keep it from step to step. It
 * counts as none if the state, an input or the step size has changed since.
 */
typedef struct {{
    double numbers[{size}];
}} {name}_history;"""

TANGENT_DECLARATION = """
/* The derivatives of rates and outputs along a direction of states, inputs and parameters. */
void {name}_tangent(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, const {name}_state *d_state, const {name}_inputs *d_inputs,
    const {name}_parameters *d_parameters, {name}_state *d_rates, {name}_outputs *d_outputs);
"""

TANGENT = """\
void {name}_tangent(double t, const {name}_state *state, const {name}_inputs *inputs,
    const {name}_parameters *parameters, const {name}_state *d_state, const {name}_inputs *d_inputs,
    const {name}_parameters *d_parameters, {name}_state *d_rates, {name}_outputs *d_outputs)
{{
    double y[SIZE], u[{input_size}], p[{parameter_size}], d_y[SIZE], d_u[{input_size}], d_p[{parameter_size}];
    double rate[SIZE], out[{output_size}];

    memcpy(y, state, sizeof y);
    memcpy(u, inputs, sizeof u);
    memcpy(p, parameters, sizeof p);
    memcpy(d_y, d_state, sizeof d_y);
    memcpy(d_u, d_inputs, sizeof d_u);
    memcpy(d_p, d_parameters, sizeof d_p);
    tangent_of(t, y, u, p, d_y, d_u, d_p, rate, out);
    memcpy(d_rates, rate, sizeof rate);
    memcpy(d_outputs, out, sizeof out);
}}"""


_NONE = Variable("unused", "", "", "nothing: C has no empty structures")


def c_module(model: ExportedModel, *, tangent: bool = False, assembly: bool = False) -> Mapping[str, str]:
    """The texts of `NAME.h` and `NAME.c`, by file name.

    :param tangent: add `NAME_tangent`, the directional derivatives of rates and outputs.
    :param assembly: add `NAME_assemble`, the start for changed parameters, even if there are no parameters.
    :raises NotImplementedError: an expression has an operation that kernels do not support either.
    """
    assembly = assembly or bool(model.parameters)
    head = HEADER.format(
        name=model.name,
        mechanism=_comment(model.mechanism.name),
        description=_comment(model.mechanism.description),
        version=__version__,
        hash=model.hash,
        changes=_changes(model),
        flags=FLAGS,
    )
    return {
        f"{model.name}.h": head + _header(model, tangent, assembly),
        f"{model.name}.c": head + _source(model, tangent, assembly),
    }


def _changes(model: ExportedModel) -> str:
    changes = {key: str(value) for key, value in model.mechanism.source.changes.items()}
    listed = ", ".join(f"{key} = {value}" for key, value in changes.items())
    return _comment(f", with {listed}" if listed else "")


def _comment(text: str) -> str:
    """A text as it can stand in a comment."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())


def _header(model: ExportedModel, tangent: bool, assembly: bool) -> str:
    guard = f"{model.name.upper()}_H"
    structures = "\n\n".join(
        _structure(f"{model.name}_{kind}", about, variables)
        for kind, about, variables in (
            (
                "state",
                "The state y: coordinates, speeds, states of actuators, and energies of the audit.",
                model.states,
            ),
            ("inputs", "What acts from outside during a step.", model.inputs),
            ("parameters", "Numbers of the mechanism that may be changed between steps.", model.parameters),
            ("outputs", "What is computed from a state on request.", model.output_variables),
        )
    )
    if model.methods[0].keeps_history:
        structures += "\n\n" + _history(model)
    steps = "\n".join(STEP_DECLARATION.format(**_step_words(model, method)) for method in model.methods)
    declared = DECLARATIONS.format(
        name=model.name,
        NAME=model.name.upper(),
        step=literal(model.step),
        method=model.methods[0].name,
        history=_step_words(model, model.methods[0])["history"],
        structures=structures,
        steps=STEP_COMMENT + steps,
    )
    declared += ASSEMBLY_DECLARATION.format(name=model.name) if assembly else ""
    declared += TANGENT_DECLARATION.format(name=model.name) if tangent else ""
    guards = f'#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n'
    return f"{guards}{declared}\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n"


def _history(model: ExportedModel) -> str:
    size = model.methods[0].history_size(len(model.states), model.equations.inputs.size)
    return HISTORY.format(name=model.name, method=model.methods[0].name, size=size)


def _step_words(model: ExportedModel, method: Method) -> dict[str, str]:
    """The names in a step function; those of Adams methods have a further argument."""
    keeps = method.keeps_history
    history = f"{model.name}_history *history, " if keeps else ""
    return {"name": model.name, "method": method.name, "history": history, "memory": "history" if keeps else "0"}


def _structure(name: str, about: str, variables: Sequence[Variable]) -> str:
    fields = [
        f"    double {one.field}; /* {_comment(one.description)}{f', {one.unit}' if one.unit else ''} */"
        for one in variables or (_NONE,)
    ]
    return "\n".join([f"/* {about} */", "typedef struct {", *fields, f"}} {name};"])


def _source(model: ExportedModel, tangent: bool, assembly: bool) -> str:
    functions = step_functions(model)
    functions += [
        "/* The numbers of the equations that depend on the parameters. */\n"
        + c_function(model.values, "values", ("p",), ("out",)),
        "/* What is computed from a state on request. */\n"
        + c_function(model.outputs, "outputs_of", ("t", "y", "in", "p"), ("out",), ("t",)),
        _definitions(model),
    ]
    functions += [PUBLIC_STEP.format(**_step_words(model, method)) for method in model.methods]
    functions += assembly_functions(model, model.start) if assembly else []
    functions += _tangent(model) if tangent else []
    if any("sine_cosine(" in function for function in functions):
        functions.insert(0, sine_cosine_text())
    includes = f'#include "{model.name}.h"\n\n#include <math.h>\n#include <string.h>\n'
    sizes = SIZES.format(size=len(model.states), given=max(1, model.equations.inputs.size), inputs=len(model.inputs))
    contraction = "#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif\n"
    return f"{includes}\n{contraction}\n{sizes}\n" + "\n\n".join(functions) + "\n"


def _tangent(model: ExportedModel) -> list[str]:
    arguments = ("t", "y", "u", "p", "d_y", "d_u", "d_p")
    return [
        "/* The derivatives of rates and outputs along a direction. */\n"
        + c_function(model.tangent(), "tangent_of", arguments, ("rate", "out"), ("t",)),
        TANGENT.format(name=model.name, **_sizes(model)),
    ]


def _sizes(model: ExportedModel) -> dict[str, int]:
    """The numbers of fields in the structures, at least one."""
    return {
        "input_size": max(1, len(model.inputs)),
        "parameter_size": max(1, len(model.parameters)),
        "output_size": max(1, len(model.output_variables)),
    }


def _definitions(model: ExportedModel) -> str:
    reports, projects = model.equations.rates.n_out() > 1, model.equations.project is not None

    def start(kind: str, variables: Sequence[Variable]) -> str:
        """The assignment of the start values of a structure."""
        return "\n".join(f"    {kind}->{one.field} = {literal(one.start)};" for one in variables or (_NONE,))

    return DEFINITIONS.format(
        **_step_words(model, model.methods[0]),
        start="\n".join(
            start(kind, variables)
            for kind, variables in (
                ("state", model.states),
                ("inputs", model.inputs),
                ("parameters", model.parameters),
            )
        ),
        inputs=len(model.inputs),
        **_sizes(model),
        margin=", &margin" if reports else "",
        declared_margin="    double margin;\n" if reports else "",
        project="    project_in_place(t, y, in);" if projects else "    (void)t;\n    (void)in;",
    )
