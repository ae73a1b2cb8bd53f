"""The start of a mechanism with changed parameters as C functions.

Speeds at a start in a singular configuration follow as in `mbd_sim.dynamics.constraints.singular_start`. Null spaces
come from the same rotations of rows as in `mbd_sim.exports.c_code.assembly_texts`, whose functions this text uses: a
column for each row, appended to the matrix, keeps the combinations of rows, and those of rows that become zero are the
null space.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.dynamics.constraints.assembly import CLOSED, CONSISTENT, ITERATIONS, LONGEST_STEP, STALLED, WEIGHTLESS
from mbd_sim.dynamics.constraints.singular_start import CURVATURE_ROUND_OFF, SATISFIED, SLOPES, STARTS
from mbd_sim.dynamics.constraints.singular_start import ITERATIONS as BRANCH_ITERATIONS
from mbd_sim.dynamics.math.rank import RANK
from mbd_sim.exports.c_code.assembly_texts import (
    RESTING_SPEEDS,
    START_OF_CONSTRAINED,
    WITH_CONSTRAINTS,
    WITHOUT_CONSTRAINTS,
)
from mbd_sim.exports.c_code.functions import c_function, literal
from mbd_sim.exports.c_code.model import ExportedModel, StartFunctions

BRANCH_OF_SPEEDS = """\
/* A singular configuration: combinations of constraints that are zero, and directions of unit energy that are free. */
struct singularity {{
    double sizes[ROWS], mass[NV * NV], stresses[ROWS * ROWS], directions[NV * NV], size, bias;
    int stress_count, direction_count;
}};

static double energy_of(const double *mass, const double *one, const double *other)
{{
    double sum = 0.0;
    int i, k;

    for (i = 0; i < NV; i++)
        for (k = 0; k < NV; k++)
            sum += one[i] * mass[k * NV + i] * other[k];
    return sum;
}}

/* The null space of the transposed matrix a, of which the first `size` columns are given; returns its dimension. */
static int null_rows(double *a, int rows, int size, double *found)
{{
    int width = size + rows, count = 0, i, k;

    for (i = 0; i < rows; i++)
        for (k = 0; k < rows; k++)
            a[i * width + size + k] = i == k ? 1.0 : 0.0;
    orthogonalize(a, rows, size, width);
    for (i = 0; i < rows; i++)
        if (!(norm_of(a + i * width, size) > {rank}))
            memcpy(found + rows * count++, a + i * width + size, rows * sizeof *found);
    return count;
}}

/* Whether there are stresses and free directions; the configuration is regular if g has its usual rank. */
static int is_singular(
    double t, const double *q, const double *v, const unsigned char *fixed, struct singularity *at)
{{
    double g[ROWS * NV], natural[ROWS * NV], sizes[ROWS], rows[ROWS * (NV + ROWS)], columns[NV * (ROWS + 2 * NV)], size;
    int i, j, k, again;

    gradient(t, q, v, g);
    natural_rows(t, q, v, g, sizes, natural);
    for (i = 0; i < ROWS; i++)
        memcpy(rows + i * (NV + ROWS), natural + i * NV, NV * sizeof *rows);
    at->stress_count = null_rows(rows, ROWS, NV, at->stresses);
    if (ROWS - at->stress_count >= {usual_rank} || !at->stress_count)
        return 0;
    memset(columns, 0, sizeof columns);
    for (i = 0; i < ROWS; i++) {{
        size = norm_of(natural + i * NV, NV);
        at->sizes[i] = sizes[i] > 0.0 ? sizes[i] * (size > {rank} ? size : 1.0) : INFINITY;
        for (k = 0; k < NV; k++)
            columns[k * (ROWS + 2 * NV) + i] = rows[i * (NV + ROWS) + k] =
                size > {rank} ? natural[i * NV + k] / size : 0.0;
    }}
    at->stress_count = null_rows(rows, ROWS, NV, at->stresses);
    for (k = 0; k < NV; k++)
        columns[k * (ROWS + 2 * NV) + ROWS + k] = fixed[k] ? 1.0 : 0.0;
    at->direction_count = null_rows(columns, NV, ROWS + NV, at->directions);
    mass_matrix(t, q, v, at->mass);
    for (i = 0; i < at->direction_count; i++)
        for (k = 0; k < NV; k++)
            at->directions[i * NV + k] *= scales[k];
    for (i = 0; i < at->direction_count; i++) {{
        double *one = at->directions + i * NV;
        for (again = 0; again < 2; again++)
            for (j = 0; j < i; j++) {{
                size = energy_of(at->mass, one, at->directions + j * NV);
                for (k = 0; k < NV; k++)
                    one[k] -= size * at->directions[j * NV + k];
            }}
        size = energy_of(at->mass, one, one);
        if (!(size > 0.0))
            return 0;
        for (k = 0; k < NV; k++)
            one[k] /= sqrt(size);
    }}
    return at->direction_count > 0;
}}

/* What the constraints with these stresses lack of zero in the second order, at the speeds u + directions . change. */
static int is_branch(double t, const double *q, const double *v, struct singularity *at, const double *u,
    const double *change, double *curvature)
{{
    double speeds[NV], terms[ROWS], squared = 0.0;
    int i, k;

    memcpy(speeds, u, sizeof speeds);
    for (i = 0; i < at->direction_count; i++)
        for (k = 0; k < NV; k++)
            speeds[k] += change[i] * at->directions[i * NV + k];
    for (k = 0; k < NV; k++)
        squared += speeds[k] * speeds[k] / (scales[k] * scales[k]);
    bias(t, q, speeds, v, terms);
    for (i = 0; i < ROWS; i++)
        terms[i] /= at->sizes[i];
    if (at->bias < 0.0)
        for (at->bias = 0.0, k = 0; k < ROWS; k++)
            for (i = 0; i < at->stress_count; i++)
                if (fabs(at->stresses[i * ROWS + k]) > {rank}) {{
                    at->bias = sqrt(at->bias * at->bias + terms[k] * terms[k]);
                    break;
                }}
    for (i = 0; i < at->stress_count; i++)
        for (curvature[i] = 0.0, k = 0; k < ROWS; k++)
            curvature[i] += at->stresses[i * ROWS + k] * terms[k];
    return norm_of(curvature, at->stress_count) <= fmax({satisfied} * at->bias, {round_off} * squared);
}}

/* Newton steps of the change of speeds, which is a solution of quadratic equations: differences give exact slopes. */
static void solve_branch(
    double t, const double *q, const double *v, struct singularity *at, const double *u, double *change)
{{
    double a[ROWS * (NV + 1)], step[NV], here[ROWS], ahead[ROWS], behind[ROWS], center, largest;
    int iteration, i, k;

    for (iteration = 0; iteration < {branch_iterations}; iteration++) {{
        is_branch(t, q, v, at, u, change, here);
        memset(a, 0, sizeof a);
        for (k = 0; k < at->direction_count; k++) {{
            center = change[k];
            change[k] = center + at->size;
            is_branch(t, q, v, at, u, change, ahead);
            change[k] = center - at->size;
            is_branch(t, q, v, at, u, change, behind);
            change[k] = center;
            for (i = 0; i < at->stress_count; i++)
                a[i * (NV + 1) + k] = (ahead[i] - behind[i]) / (2.0 * at->size);
        }}
        largest = norm_of(a, at->stress_count * (NV + 1));
        for (i = 0; i < at->stress_count; i++)
            a[i * (NV + 1) + NV] = -here[i];
        memset(step, 0, sizeof step);
        add_least(a, at->stress_count, step, {slopes} * largest);
        for (k = 0; k < at->direction_count; k++)
            change[k] += step[k];
        if (norm_of(step, NV) <= 1e-15 * at->size)
            break;
    }}
}}

/* In a singular configuration: move speeds that satisfy the constraints to the nearest found with which it can move. */
static void choose_branch(double t, const double *q, double *u, const double *v, const unsigned char *fixed)
{{
    struct singularity at;
    double change[NV], best[NV], curvature[ROWS], least = INFINITY;
    uint32_t random = 1;
    int start, i, k;

    if (norm_of(u, NV) == 0.0 || !is_singular(t, q, v, fixed, &at))
        return;
    at.bias = -1.0;
    memset(change, 0, sizeof change);
    if (is_branch(t, q, v, &at, u, change, curvature))
        return;
    at.size = sqrt(energy_of(at.mass, u, u));
    at.size = at.size > 0.0 ? at.size : 1.0;
    for (start = 0; start < {branch_starts}; start++) {{
        for (k = 0; k < at.direction_count; k++)
            for (change[k] = 0.0, i = 0; i < 3; i++) {{
                random = random * 1664525u + 1013904223u;
                change[k] += at.size * ((random >> 8) / 8388608.0 - 1.0); /* three of them have a variance of 1 */
            }}
        solve_branch(t, q, v, &at, u, change);
        if (is_branch(t, q, v, &at, u, change, curvature) &&
            norm_of(change, at.direction_count) < (1.0 - 1e-9) * least) {{
            least = norm_of(change, at.direction_count);
            memcpy(best, change, sizeof best);
        }}
    }}
    if (least < INFINITY)
        for (i = 0; i < at.direction_count; i++)
            for (k = 0; k < NV; k++)
                u[k] += best[i] * at.directions[i * NV + k];
}}"""


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
{project}    memcpy(state, y, sizeof y);
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
                round_off=literal(CURVATURE_ROUND_OFF),
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
            project="    project_in_place(t, y, in);\n" if normalizes else "",
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
