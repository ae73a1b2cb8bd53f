"""Steps of Adams methods as C text, with the operations of `mbd_sim.compiler.adams_step`."""

from __future__ import annotations

from mbd_sim.c_code.c_functions import literal
from mbd_sim.c_code.c_steps import StepParts, weighted_sum
from mbd_sim.compiler.adams_step import LONGEST_PAUSE
from mbd_sim.integrators.adams import Adams

HISTORY = """\
/*
 * The slopes of earlier steps, for {method}: set it to zero before the first step, and keep it from step to step. It
 * counts as none if the state, an input or the step size has changed since. `lost` is the round-off of the state.
 */
typedef struct {{
    double count, wait, pause, next, size;
    double state[{size}], inputs[{given}], lost[{size}], slopes[{length}][{size}];
}} {name}_history;"""

_STEP = """\
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

/*
 * A step of {method}, order {order}: prediction and correction, or else a step of {otherwise} from the same slopes.
 * Round-off is carried from step to step (Kahan's summation).
 */
static void step_{method}(
    int64_t index, double t, double t_next, double h, double *y, const double *in, void *memory)
{{
    {name}_history *past = memory;
    double current[SIZE], predicted[SIZE], increment[SIZE], partial[SIZE], trial[SIZE];
    double next[SIZE], lost[SIZE], errors[SIZE], slope, added, error, smallest, *f[{length}];
    double count, wait, pause{margins};
    int same = past->next == (double)index && past->size == h, tries, taken = 0, i;

    for (i = 0; i < SIZE; i++)
        same &= past->state[i] == y[i];
    for (i = 0; i < {compared}; i++)
        same &= past->inputs[i] == in[i];
    count = same ? past->count : 0.0;
    wait = same ? past->wait : 0.0;
    pause = same ? past->pause : 0.0;
    for (i = 0; i < SIZE; i++)
        past->lost[i] = same ? past->lost[i] : 0.0;
    for (i = 0; i < {length}; i++) /* f[i] are the slopes i steps ago */
        f[i] = past->slopes[(index + {length} - i) % {length}];

    rates(t, y, in, current{margin});
    if (wait <= {length})
        memcpy(f[0], current, sizeof current);
    count += 1.0;
    tries = count >= {length} && wait <= 0.0{condition};
    wait = tries ? 0.0 : wait - 1.0;
    if (tries) {{
        for (i = 0; i < SIZE; i++) {{
            increment[i] = h * ({predictor});
            partial[i] = {corrector};
            trial[i] = y[i] + increment[i];
        }}
        rates(t + 1.0 * h, trial, in, predicted{ignored});
        for (i = 0; i < SIZE; i++) {{
            slope = fma({newest}, predicted[i], partial[i]);
            added = fma(h, slope, past->lost[i]);
            next[i] = y[i] + added;
            lost[i] = added - (next[i] - y[i]);
            error = fabs(fma(h, slope, -increment[i])) * (1.0 / (1.0 + fabs(y[i])));
            errors[i] = error != error ? INFINITY : error;
        }}
        taken = largest_of(errors) <= {tolerance};
        if (!taken) {{ /* differences of lower order have less round-off */
            for (i = 0; i < SIZE; i++) {{
                smallest = errors[i];
{lower}
                errors[i] = smallest;
            }}
            taken = largest_of(errors) <= {tolerance};
        }}
        if (taken) {{
            pause = 0.0;
        }} else {{ /* a new history, after a pause that is longer each time */
            count = 0.0;
            wait = pause;
            pause = pause + pause + 1.0 < {longest} ? pause + pause + 1.0 : {longest};
        }}
    }}
    if (taken) {{
        memcpy(y, next, sizeof next);
        memcpy(past->lost, lost, sizeof lost);
    }} else {{
        memset(past->lost, 0, sizeof past->lost);
        advance_{otherwise}(t, h, y, in, current{value});
    }}
{project}
    past->count = count;
    past->wait = wait;
    past->pause = pause;
    past->next = (double)(index + 1);
    past->size = h;
    memcpy(past->state, y, sizeof past->state);
    memcpy(past->inputs, in, {compared} * sizeof(double));
}}"""

_LOWER = """\
                error = fabs(h * {newest} * (predicted[i] - ({difference}))) * (1.0 / (1.0 + fabs(y[i])));
                if (error < smallest)
                    smallest = error;"""


def adams_function(method: Adams, parts: StepParts, name: str, compared: int) -> str:
    """`static void step_METHOD(…, void *memory)`, whose `memory` is a `NAME_history`.

    :param compared: the number of inputs.
    """
    slopes = [f"f[{back}]" for back in range(method.length)]
    newest = literal(method.newest)
    lower = "\n".join(
        _LOWER.format(newest=newest, difference=weighted_sum(weights, slopes)) for weights in method.lower
    )
    reports = parts.reports_margin
    return _STEP.format(
        method=method.name,
        order=method.order,
        otherwise=method.otherwise.name,
        name=name,
        length=method.length,
        compared=compared,
        predictor=weighted_sum(method.predictor, slopes),
        corrector=weighted_sum(method.corrector, slopes),
        newest=newest,
        tolerance=literal(method.tolerance),
        lower=lower,
        longest=literal(LONGEST_PAUSE),
        margins=", margin, ignored" if reports else "",
        margin=", &margin" if reports else "",
        ignored=", &ignored" if reports else "",
        value=", margin" if reports else "",
        condition=" && !(margin < 0.0)" if reports else "",
        project="    project_in_place(t_next, y, in);" if parts.projects else "    (void)t_next;",
    )
