"""The parts of a C module that are the same for all mechanisms."""

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

PROJECTION = """\
static void project_in_place(double t, double *y, const double *in)
{
    double projected[SIZE];

    projection(t, y, in, projected);
    memcpy(y, projected, sizeof projected);
}"""

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
    int64_t index, double t, double t_next, double h, double *y, const double *in, void *memory);

static int take(step_function *step, {name}_state *state, void *memory, const {name}_inputs *inputs,
    const {name}_parameters *parameters, int64_t index, double t, double t_next, double h)
{{
    double y[SIZE], in[GIVEN], p[{parameter_size}], zero = 0.0;
    int i;

    memcpy(y, state, sizeof y);
    collect(inputs, parameters, in, p);
    step(index, t, t_next, h, y, in, memory);
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
