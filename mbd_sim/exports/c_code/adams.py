"""Steps of Adams methods as C text, with the operations of `mbd_sim.compiler.steps.adams`."""

from __future__ import annotations

from mbd_sim.compiler.steps.adams import DIVISIBLE, HALVED, LONGEST_PAUSE, NEARLY, PATIENCE, PROBED_EVERY, REFINABLE
from mbd_sim.compiler.steps.adams_attempt import GROWING, SHRINKING
from mbd_sim.exports.c_code.functions import literal
from mbd_sim.exports.c_code.steps import StepParts, weighted_sum
from mbd_sim.integrators.adams import LOWER, PARTS, Adams
from mbd_sim.integrators.method import Scales

HISTORY = """\
/*
 * The slopes of earlier steps, for {method}: set it to zero before the first step, and keep it from step to step. It
 * counts as none if the state, an input or the step size has changed since. `lost` is the round-off of the state. The
 * slopes at the start of step k have the place {parts} k of a ring, and those within it the places that follow.
 */
typedef struct {{
    double count, level, wait, pause, next, size;
    double state[{size}], inputs[{given}], lost[{size}], slopes[{places}][{size}];
}} {name}_history;"""

_ERROR = """\
/* What the errors of the components are relative to beside these. */
static const double error_scales[SIZE] = {{{scales}}};

/* The largest error of a component, relative to its scale + |y|. */
static double largest_of(const double *errors)
{{
    double largest = 0.0;
    int i;

    for (i = 0; i < SIZE; i++)
        if (errors[i] > largest)
            largest = errors[i];
    return largest;
}}

/* The difference `pairs` pairs of orders above a, if they shrink as from c to a or from d to b. */
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
        scale = 1.0 / (error_scales[i] + fabs(y[i]));
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
    double t, double h, const double *y, const double *const *f, const double *in, double *moved, double *left,
    double *predicted)
{{
    double increment[SIZE], partial[SIZE], trial[SIZE], errors[SIZE], slope, added, before{unread};
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
        errors[i] = fabs(fma(h, slope, -increment[i])) * (1.0 / (error_scales[i] + fabs(y[i])));
        if (errors[i] != errors[i])
            errors[i] = INFINITY;
    }}
    if (largest_of(errors) > {tolerance})
        reduce(h, y, predicted, f, errors);
    return largest_of(errors);
}}

"""

_STEP = """\
/* Interpolates slopes halfway between those f[i], which are so many places apart, of which `newest` is the next. */
static void refine_slopes({name}_history *past, int64_t first, int stride, const double *newest, const double *const *f)
{{
    double *target;
    int i;

{midpoints}
}}

/*
 * Attempts a step in so many parts from y to `moved`, with slopes of which the first has the place `first`; the largest
 * error. `first_predicted` are the slopes of the first prediction.
 */
static double attempt(
    double t, double h, int parts, int64_t first, const double *y, const double *in, {name}_history *past,
    double *moved, double *left, double *first_predicted)
{{
    const double *f[{length}];
    double size = h / (double)parts, error, worst = 0.0, predicted[SIZE]{unread};
    int stride = {parts} / parts, part, i;

    memcpy(moved, y, SIZE * sizeof(double));
    memcpy(left, past->lost, sizeof past->lost);
    for (part = 0; part < parts && worst <= {tolerance}; part++) {{
        if (part > 0)
            rates(t + (double)part * size, moved, in, past->slopes[(first + part * stride) % {places}]{ignored});
        for (i = 0; i < {length}; i++)
            f[i] = past->slopes[(first + {places} + (part - i) * stride) % {places}];
        error = predict_and_correct(t + (double)part * size, size, y, f, in, moved, left, predicted);
        if (part == 0)
            memcpy(first_predicted, predicted, SIZE * sizeof(double));
        if (error > worst)
            worst = error;
    }}
    return worst;
}}

/*
 * A step of {method}, order {order}: prediction and correction, at once or in two or four parts, or else a step of
 * {otherwise} from the same slopes. Round-off is carried from step to step (Kahan's summation).
 */
static void step_{method}(
    int64_t index, double t, double t_next, double h, double *y, const double *in, void *memory)
{{
    {name}_history *past = memory;
    const double *f[{length}];
    double current[SIZE], moved[SIZE], left[SIZE], first_predicted[SIZE], error, part, count, wait, pause{margins};
    int64_t first = {parts} * index;
    int same = past->next == (double)index && past->size == h;
    int counts, ready, level, tried, stride, probes, parts, taken = 0, i;

    for (i = 0; i < SIZE; i++)
        same &= past->state[i] == y[i];
    for (i = 0; i < {compared}; i++)
        same &= past->inputs[i] == in[i];
    count = same ? past->count : 0.0;
    level = same ? (int)past->level : 0;
    wait = same ? past->wait : 0.0;
    pause = same ? past->pause : 0.0;
    for (i = 0; i < SIZE; i++)
        past->lost[i] = same ? past->lost[i] : 0.0;

    rates(t, y, in, current{margin});
    counts = wait <= 0.0;
    if (counts)
        memcpy(past->slopes[first % {places}], current, sizeof current);
    count = counts ? count + 1.0 : 0.0;
    ready = counts{condition};
    wait = counts ? 0.0 : wait - 1.0;
    for (tried = 0; ready && !taken && tried <= {finest}; tried++) {{
        probes = level == tried + 1 && count >= {kept} && ((int64_t)count & ({probed} << level)) == 0;
        if (!probes && (level != tried || count < {length}))
            continue;
        error = attempt(t, h, 1 << tried, first, y, in, past, moved, left, first_predicted);
        taken = error <= {tolerance};
        if (taken) {{
            if (count >= {patient})
                pause = 0.0;
            if (probes)
                count = (double)(int64_t)(0.5 * count);
            count += (double)((1 << tried) - 1);
            level = tried;
        }} else if (!probes) {{
            if (tried < {finest} && error <= {refinable}) {{
                stride = {parts} >> tried;
                for (i = 0; i < {length}; i++)
                    f[i] = past->slopes[(first + {places} - i * stride) % {places}];
                refine_slopes(past, first, stride, first_predicted, f);
                count = {length};
                level = tried + 1;
            }} else if (tried == {finest} && error <= {nearly} && count >= {patient}) {{
                count = {length} - 1.0;
            }} else {{ /* a new history, after a pause that is longer each time */
                count = 0.0;
                level = 0;
                if (error <= {divisible} && tried + 1 <= {finest})
                    level = tried + 1;
                else if (error <= {twice_divisible} && tried + 2 <= {finest})
                    level = tried + 2;
                wait = pause;
                pause = pause + pause + 1.0 < {longest} ? pause + pause + 1.0 : {longest};
                break;
            }}
        }}
    }}
    if (taken) {{
        memcpy(y, moved, sizeof moved);
        memcpy(past->lost, left, sizeof left);
    }} else {{
        memset(past->lost, 0, sizeof past->lost);
        parts = counts && wait <= 0.0 ? 1 << level : 1;
        part = h / (double)parts;
        for (i = 0; i < parts; i++) {{
            if (i > 0) {{
                rates(t + (double)i * part, y, in, current{ignored});
                memcpy(past->slopes[(first + i * ({parts} / parts)) % {places}], current, sizeof current);
                count += 1.0;
            }}
            advance_{otherwise}(t + (double)i * part, part, y, in, current{value});
        }}
    }}
{project}
    past->count = count;
    past->level = (double)level;
    past->wait = wait;
    past->pause = pause;
    past->next = (double)(index + 1);
    past->size = h;
    memcpy(past->state, y, sizeof past->state);
    memcpy(past->inputs, in, {compared} * sizeof(double));
}}"""

_MIDPOINT = """\
    target = past->slopes[(first + {places} - {back} * stride - stride / 2) % {places}];
    for (i = 0; i < SIZE; i++)
        target[i] = {value};"""
_DIFFERENCE = "        d{order} = fabs(factor * (newest[i] - ({difference}))) * scale;"


def adams_function(method: Adams, parts: StepParts, name: str, compared: int, finest: int, scales: Scales) -> str:
    """`static void step_METHOD(…, void *memory)`, whose `memory` is a `NAME_history`.

    :param compared: the number of inputs.
    :param finest: see `finest_level`.
    :param scales: of the errors.
    """
    slopes = [f"f[{back}]" for back in range(method.length)]
    differences = [
        _DIFFERENCE.format(order=order, difference=weighted_sum(weights, slopes))
        for order, weights in zip(LOWER, method.differences, strict=True)
    ]
    midpoints = [
        _MIDPOINT.format(back=back, places=PARTS * method.length, value=weighted_sum(weights, ["newest", *slopes]))
        for back, weights in enumerate(method.midpoints)
    ]
    reports, tolerance = parts.reports_margin, method.tolerance
    return (_ERROR + _STEP).format(
        scales=", ".join(map(literal, scales)),
        method=method.name,
        order=method.order,
        otherwise=method.otherwise.name,
        name=name,
        length=method.length,
        kept=2 * method.length,
        parts=PARTS,
        finest=finest,
        places=PARTS * method.length,
        compared=compared,
        midpoints="\n".join(midpoints),
        predictor=weighted_sum(method.predictor[::-1], slopes[::-1]),
        corrector=weighted_sum(method.corrector[::-1], slopes[::-1]),
        newest=literal(method.newest),
        tolerance=literal(tolerance),
        growing=literal(GROWING * tolerance),
        shrinking=literal(SHRINKING * tolerance),
        nearly=literal(NEARLY * tolerance),
        refinable=literal(REFINABLE * tolerance),
        divisible=literal(DIVISIBLE * tolerance),
        twice_divisible=literal(DIVISIBLE * HALVED * tolerance),
        patient=literal(method.length + PATIENCE),
        probed=PROBED_EVERY - 1,
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
