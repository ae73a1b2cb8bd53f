"""The start of a mechanism with changed parameters as C functions."""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.c_code.c_assembly_texts import (
    RESTING_SPEEDS,
    START_OF_CONSTRAINED,
    WITH_CONSTRAINTS,
    WITHOUT_CONSTRAINTS,
)
from mbd_sim.c_code.c_branch_text import BRANCH_OF_SPEEDS
from mbd_sim.c_code.c_functions import c_function, literal
from mbd_sim.c_code.exported_model import ExportedModel
from mbd_sim.c_code.start_functions import StartFunctions
from mbd_sim.dynamics.assembly import CLOSED, CONSISTENT, ITERATIONS, LONGEST_STEP, STALLED, WEIGHTLESS
from mbd_sim.dynamics.constraint_rank import RANK
from mbd_sim.dynamics.singular_start import ITERATIONS as BRANCH_ITERATIONS
from mbd_sim.dynamics.singular_start import ROUND_OFF, SATISFIED, SLOPES, STARTS

# The functions of (t, q, parameters) that closing loops and fitting speeds evaluate.
CONSTRAINTS = (
    "position",
    "gradient",
    "row_sizes",
    "drift",
    "rate_of_drives",
    "mass_matrix",
    "momentum",
    "branch_checks",
)

ASSEMBLY_DECLARATION = """
/*
 * Set the start state for parameters that were changed after {name}_start: positions and speeds that formulas in the
 * file give, closed loops, and the states and commands of actuators before the first command. In a singular
 * configuration, speeds are those of one of the branches that meet there. Returns 1; or, with nothing changed, 0 if
 * loops cannot be closed, -1 if the speeds that the file gives violate constraints, and -2 if a value at the start
 * depends on a changed parameter by no short formula ({name}_unknown_start names both).
 */
int {name}_assemble({name}_state *state, {name}_inputs *inputs, const {name}_parameters *parameters);

/* After -2: what that value and that parameter are. */
const char *{name}_unknown_start(const {name}_parameters *parameters, const unsigned char *given);

/*
 * The same at the time t, where the fields of state, and after them those of inputs, whose `given` is not 0 keep their
 * values: the others move as little as possible. Given values change if loops cannot be closed otherwise. A null
 * pointer stands for none.
 */
int {name}_assemble_given(double t, {name}_state *state, {name}_inputs *inputs, const {name}_parameters *parameters,
    const unsigned char *given);
"""

_PUBLIC = """\
const char *{name}_unknown_start(const {name}_parameters *parameters, const unsigned char *given)
{{
    static const struct {{
        int start, parameter;
        double value;
        const char *text;
    }} unknown[] = {{ {unknown} }};
    double p[{parameter_size}];
    size_t i;

    memcpy(p, parameters, sizeof p);
    for (i = 0; i + 1 < sizeof unknown / sizeof unknown[0]; i++)
        if (p[unknown[i].parameter] != unknown[i].value && !(given && given[unknown[i].start]))
            return unknown[i].text;
    return 0;
}}

int {name}_assemble_given(double t, {name}_state *state, {name}_inputs *inputs, const {name}_parameters *parameters,
    const unsigned char *given)
{{
    double y[SIZE], in[GIVEN], p[{parameter_size}], held_y[SIZE], held_in[GIVEN];
    int i, result;

    if ({name}_unknown_start(parameters, given))
        return -2;
    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
    result = assemble_given(t, y, in, p, given);
    if (result != 1)
        return result;
    for (i = {core}; i < SIZE; i++)
        y[i] = given && given[i] ? y[i] : 0.0;
    held(y, in, p, held_y, held_in);
    for (i = {core}; i < SIZE; i++)
        y[i] = given && given[i] ? y[i] : held_y[i];
    for (i = {efforts}; i < {inputs}; i++)
        in[i] = given && given[SIZE + i] ? in[i] : held_in[i];
{settle}    memcpy(state, y, sizeof y);
    memcpy(inputs, in, {inputs} * sizeof(double));
    return 1;
}}

int {name}_assemble({name}_state *state, {name}_inputs *inputs, const {name}_parameters *parameters)
{{
    return {name}_assemble_given(0.0, state, inputs, parameters, 0);
}}"""


def assembly_functions(model: ExportedModel, start: StartFunctions) -> list[str]:
    """The functions that `ASSEMBLY_DECLARATION` declares; they call others of the module."""
    equations = model.equations
    layout, traced = equations.layout, start.constraints
    functions = [
        "/* The positions and speeds that the file gives. */\n" + c_function(start.given, "start_of", ("p",), ("out",)),
        "/* The states and commands of actuators before the first command. */\n"
        + c_function(start.held, "held", ("y", "in", "p"), ("out", "in_out")),
    ]
    sizes = {"nq": layout.nq, "nv": layout.nv, "coordinates": max(1, layout.nq + layout.nv)}
    if traced is None:
        functions.append(WITHOUT_CONSTRAINTS.format(**sizes))
    else:
        functions += [
            c_function(getattr(traced, name), name, ("t", "q", "v"), ("out",), ("t",)) for name in CONSTRAINTS
        ]
        functions.append(c_function(traced.displaced, "displaced", ("q", "move", "v"), ("out",)))
        functions.append(c_function(traced.bias, "bias", ("t", "q", "u", "v"), ("out",), ("t",)))
        functions += [
            text.format(
                **sizes,
                rank=literal(RANK),
                usual_rank=equations.start.rank,
                satisfied=literal(SATISFIED),
                round_off=literal(ROUND_OFF),
                slopes=literal(SLOPES),
                branch_starts=STARTS,
                branch_iterations=BRANCH_ITERATIONS,
                rows=len(equations.rows),
                branches=traced.branch_checks.nnz_out(0),
                holonomic=_flags(traced.holonomic.tolist()),
                fixed_in_assembly=_flags(start.fixed_in_assembly),
                fixed_speeds=_flags(start.fixed_speeds),
                first=", ".join(str(first) for first, _ in start.coordinates),
                count=", ".join(str(count) for _, count in start.coordinates),
                scales=", ".join(map(literal, traced.scales.tolist())),
                closed=literal(CLOSED),
                iterations=ITERATIONS,
                longest=literal(LONGEST_STEP),
                stalled=literal(STALLED),
                consistent=literal(CONSISTENT),
                inputs=len(model.inputs),
                weightless=literal(WEIGHTLESS),
            )
            for text in (WITH_CONSTRAINTS, BRANCH_OF_SPEEDS, RESTING_SPEEDS, START_OF_CONSTRAINED)
        ]
    normalizes = traced is None and equations.project is not None
    functions.append(
        _PUBLIC.format(
            name=model.name,
            unknown="".join(_unknown(model, *pair) for pair in start.without_formula) + "{ 0, 0, 0.0, 0 }",
            parameter_size=max(1, len(model.parameters)),
            core=layout.nq + layout.nv,
            efforts=layout.nv,
            inputs=len(model.inputs),
            settle="    project_in_place(t, y, in);\n" if normalizes else "",
        )
    )
    return functions


def _flags(flags: Sequence[bool]) -> str:
    return ", ".join(str(int(flag)) for flag in flags)


def _unknown(model: ExportedModel, place: int, parameter: int) -> str:
    """An entry of the table of values at the start without formulas."""
    named, key = [*model.states, *model.inputs][place], model.parameters[parameter]
    text = (
        f"the start value of {named.name} depends on {key.name} by no short formula: set it as well, or export the "
        "file with that value."
    )
    return f'{{ {place}, {parameter}, {literal(key.start)}, "{text}" }}, '
