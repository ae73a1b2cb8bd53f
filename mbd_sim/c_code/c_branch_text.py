"""Speeds at a start in a singular configuration as C text: what `mbd_sim.dynamics.singular_start` does.

Null spaces come from the same rotations of rows as in `mbd_sim.c_code.c_assembly_texts`, whose functions this text
uses: a column for each row, appended to the matrix, keeps the combinations of rows, and those of rows that become zero
are the null space.
"""

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
