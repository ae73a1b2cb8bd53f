"""Steps of Adams methods as C text, with the operations of `mbd_sim.compiler.adams_step`."""

from __future__ import annotations

from mbd_sim.c_code.c_functions import literal
from mbd_sim.c_code.c_steps import StepParts, weighted_sum
from mbd_sim.compiler.adams_error import GROWING, SHRINKING
from mbd_sim.compiler.adams_step import DIVISIBLE, EASILY, LONGEST_PAUSE, NEARLY, PATIENCE, PROBED_EVERY
from mbd_sim.integrators.adams import LOWER, Adams

HISTORY = """\
/*
 * The slopes of earlier steps, for {method}: set it to zero before the first step, and keep it from step to step. It
 * counts as none if the state, an input or the step size has changed since. `lost` is the round-off of the state. The
 * slopes at the start of step k have the place 2 k of a ring, and those in its middle 2 k + 1.
 */
typedef struct {{
    double count, halves, divided, wait, pause, next, size;
    double state[{size}], inputs[{given}], lost[{size}], slopes[{places}][{size}];
}} {name}_history;"""

_ERROR = """\
/* The largest error of a component, relative to 1 + |y|. */
static double largest_of(const double *errors)
{{
    double largest = 0.0;
    int i;

    for (i = 0; i < SIZE; i++)
        if (errors[i] > largest)
            largest = errors[i];
    return largest;
}}

/* The difference of so many pairs of orders more than a, if they shrink as from c to a or from d to b. */
static double extrapolated(double a, double b, double c, double d, int pairs)
{{
    double first = a / c, second = b / d, decay = first > second ? first : second;
    double power = pairs == 2 ? decay * decay : decay, one = a * power, two = b * (power * sqrt(decay));
    double size = one > two ? one : two;

    return size != size ? INFINITY : size;
}}

/* The errors without round-off, of which differences of lower order have less. */
static void reduce(double h, const double *y, const double *newest, const double *const *f, double *errors)
{{
    double factor = h * {newest}, scale, own, expected, other, {names};
    int i;

    for (i = 0; i < SIZE; i++) {{
        scale = 1.0 / (1.0 + fabs(y[i]));
        own = errors[i];
{differences}
        expected = extrapolated(d8, d7, d6, d5, 1);
        other = extrapolated(d6, d5, d4, d3, 2);
        expected = expected < other ? expected : other;
        expected = own <= (own >= d8 ? {growing} : {shrinking}) ? expected : own;
        own = d7 < own ? d7 : own;
        own = d8 < own ? d8 : own;
        errors[i] = expected < own ? expected : own;
    }}
}}

/* Prediction and correction of the state `moved` and its round-off, with the slopes f[i], i h ago; the error. */
static double predict_and_correct(
    double t, double h, const double *y, const double *const *f, const double *in, double *moved, double *left)
{{
    double predicted[SIZE], increment[SIZE], partial[SIZE], trial[SIZE], errors[SIZE], slope, added, before{unread};
    int i;

    for (i = 0; i < SIZE; i++) {{
        increment[i] = h * ({predictor});
        partial[i] = {corrector};
        trial[i] = moved[i] + increment[i];
    }}
    rates(t + h, trial, in, predicted{ignored});
    for (i = 0; i < SIZE; i++) {{
        slope = fma({newest}, predicted[i], partial[i]);
        added = fma(h, slope, left[i]);
        before = moved[i];
        moved[i] = before + added;
        left[i] = added - (moved[i] - before);
        errors[i] = fabs(fma(h, slope, -increment[i])) * (1.0 / (1.0 + fabs(y[i])));
        if (errors[i] != errors[i])
            errors[i] = INFINITY;
    }}
    if (largest_of(errors) > {tolerance})
        reduce(h, y, predicted, f, errors);
    return largest_of(errors);
}}

"""

_STEP = """\
/*
 * A step of {method}, order {order}: prediction and correction, at once or in two halves, or else a step of
 * {otherwise} from the same slopes. Round-off is carried from step to step (Kahan's summation).
 */
static void step_{method}(
    int64_t index, double t, double t_next, double h, double *y, const double *in, void *memory)
{{
    {name}_history *past = memory;
    const double *f[{length}];
    double current[SIZE], moved[SIZE], left[SIZE], half = 0.5 * h, error, worst, limit;
    double *start = past->slopes[2 * index % {places}], *middle = past->slopes[(2 * index + 1) % {places}];
    double count, halves, wait, pause{margins};
    int same = past->next == (double)index && past->size == h, divided, ready, tries, taken = 0, i;

    for (i = 0; i < SIZE; i++)
        same &= past->state[i] == y[i];
    for (i = 0; i < {compared}; i++)
        same &= past->inputs[i] == in[i];
    count = same ? past->count : 0.0;
    halves = same ? past->halves : 0.0;
    divided = same && past->divided != 0.0;
    wait = same ? past->wait : 0.0;
    pause = same ? past->pause : 0.0;
    for (i = 0; i < SIZE; i++)
        past->lost[i] = same ? past->lost[i] : 0.0;

    rates(t, y, in, current{margin});
    if (wait <= {places})
        memcpy(start, current, sizeof current);
    count += 1.0;
    halves += 1.0;
    ready = wait <= 0.0{condition};
    tries = ready && divided && halves >= {length};
    if (ready && count >= {length} && (!divided || ((int)halves & {probed}) == 0)) {{
        tries = 1;
        memcpy(moved, y, sizeof moved);
        memcpy(left, past->lost, sizeof left);
        for (i = 0; i < {length}; i++)
            f[i] = past->slopes[(2 * index + {places} - 2 * i) % {places}];
        error = predict_and_correct(t, h, y, f, in, moved, left);
        limit = divided ? {easily} : {tolerance};
        taken = error <= limit;
        wait = 0.0;
        if (taken) {{
            pause = 0.0;
            divided = 0;
        }} else if (!divided) {{
            if (error <= {nearly} && count >= {patient}) {{
                count = {length} - 1.0;
            }} else {{ /* a new history: of halves, or after a pause that is longer each time */
                count = halves = 0.0;
                if (error <= {divisible}) {{
                    divided = 1;
                }} else {{
                    wait = pause;
                    pause = pause + pause + 1.0 < {longest} ? pause + pause + 1.0 : {longest};
                }}
            }}
            tries = 0;
        }}
    }} else {{
        wait = tries ? 0.0 : wait - 1.0;
    }}
    if (tries && !taken && halves >= {length}) {{
        memcpy(moved, y, sizeof moved);
        memcpy(left, past->lost, sizeof left);
        worst = 0.0;
        for (i = 0; i < {length}; i++)
            f[i] = past->slopes[(2 * index + {places} - i) % {places}];
        error = predict_and_correct(t, half, y, f, in, moved, left);
        if (error > worst)
            worst = error;
        if (worst <= {tolerance}) {{
            rates(t + half, moved, in, middle{ignored});
            for (i = {length} - 1; i > 0; i--)
                f[i] = f[i - 1];
            f[0] = middle;
            error = predict_and_correct(t + half, half, y, f, in, moved, left);
            if (error > worst)
                worst = error;
        }}
        taken = worst <= {tolerance};
        if (taken) {{
            pause = 0.0;
            halves += 1.0;
        }} else if (worst <= {nearly} && halves >= {patient}) {{
            halves = {length};
        }} else {{
            count = halves = 0.0;
            divided = 0;
            wait = pause;
            pause = pause + pause + 1.0 < {longest} ? pause + pause + 1.0 : {longest};
        }}
    }}
    if (taken) {{
        memcpy(y, moved, sizeof moved);
        memcpy(past->lost, left, sizeof left);
    }} else {{
        memset(past->lost, 0, sizeof past->lost);
        if (divided && wait <= 0.0) {{
            advance_{otherwise}(t, half, y, in, current{value});
            rates(t + half, y, in, middle{ignored});
            halves += 1.0;
            advance_{otherwise}(t + half, half, y, in, middle{value});
        }} else {{
            advance_{otherwise}(t, h, y, in, current{value});
        }}
    }}
{project}
    past->count = count;
    past->halves = halves;
    past->divided = divided;
    past->wait = wait;
    past->pause = pause;
    past->next = (double)(index + 1);
    past->size = h;
    memcpy(past->state, y, sizeof past->state);
    memcpy(past->inputs, in, {compared} * sizeof(double));
}}"""

_DIFFERENCE = "        d{order} = fabs(factor * (newest[i] - ({difference}))) * scale;"


def adams_function(method: Adams, parts: StepParts, name: str, compared: int) -> str:
    """`static void step_METHOD(…, void *memory)`, whose `memory` is a `NAME_history`.

    :param compared: the number of inputs.
    """
    slopes = [f"f[{back}]" for back in range(method.length)]
    differences = [
        _DIFFERENCE.format(order=order, difference=weighted_sum(weights, slopes))
        for order, weights in zip(LOWER, method.differences, strict=True)
    ]
    reports, tolerance = parts.reports_margin, method.tolerance
    return (_ERROR + _STEP).format(
        method=method.name,
        order=method.order,
        otherwise=method.otherwise.name,
        name=name,
        length=method.length,
        places=2 * method.length,
        compared=compared,
        predictor=weighted_sum(method.predictor[::-1], slopes[::-1]),
        corrector=weighted_sum(method.corrector[::-1], slopes[::-1]),
        newest=literal(method.newest),
        tolerance=literal(tolerance),
        growing=literal(GROWING * tolerance),
        shrinking=literal(SHRINKING * tolerance),
        easily=literal(EASILY * tolerance),
        nearly=literal(NEARLY * tolerance),
        divisible=literal(DIVISIBLE * tolerance),
        patient=literal(method.length + PATIENCE),
        probed=2 * PROBED_EVERY - 2,
        names=", ".join(f"d{order}" for order in LOWER),
        differences="\n".join(differences),
        longest=literal(LONGEST_PAUSE),
        margins=", margin, ignored" if reports else "",
        unread=", ignored" if reports else "",
        margin=", &margin" if reports else "",
        ignored=", &ignored" if reports else "",
        value=", margin" if reports else "",
        condition=" && !(margin < 0.0)" if reports else "",
        project="    project_in_place(t_next, y, in);" if parts.projects else "    (void)t_next;",
    )
