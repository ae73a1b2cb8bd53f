"""The start of a mechanism with changed parameters as C text: what `mbd_sim.dynamics.constraints.start` does.

Loops are closed by Gauss–Newton steps of least norm, and speeds are those of least kinetic energy, as in
`mbd_sim.dynamics.constraints.assembly`, whose tolerances are the same. Instead of singular values, rows are made
orthogonal by rotations (Hestenes 1958), which finds the same solutions of least norm: Golub & Van Loan, sec. 8.6.3.

In singular configurations `mbd_sim.exports.c_code.assembly` chooses the branch.

The texts are formatted by `mbd_sim.exports.c_code.assembly`. Matrices that CasADi's functions return are stored by
columns, all others by rows.
"""

WITHOUT_CONSTRAINTS = """\
/* The start has no constraints. */
static int assemble_given(double t, double *y, const double *in, const double *p, const unsigned char *given)
{{
    double start[{coordinates}];
    int i;

    (void)t;
    (void)in;
    start_of(p, start);
    for (i = 0; i < {nq} + {nv}; i++)
        y[i] = given && given[i] ? y[i] : start[i];
    return 1;
}}"""

WITH_CONSTRAINTS = """\
enum {{ ROWS = {rows}, NQ = {nq}, NV = {nv}, BRANCHES = {branches} }};

static const unsigned char holonomic[] = {{ {holonomic} }};
static const unsigned char fixed_in_assembly[] = {{ {fixed_in_assembly} }};
static const unsigned char fixed_speeds[] = {{ {fixed_speeds} }};
static const double scales[] = {{ {scales} }}; /* the natural units of speeds and displacements */
static const int first_of[] = {{ {first} }}; /* in q, of what each speed moves, and how many there are */
static const int count_of[] = {{ {count} }};

/* Rotate rows of a matrix pairwise until their first `size` columns are orthogonal. */
static void orthogonalize(double *a, int rows, int size, int width)
{{
    int sweep, i, j, k, turned = 1;

    for (sweep = 0; turned && sweep < 60; sweep++) {{
        turned = 0;
        for (i = 0; i < rows; i++)
            for (j = i + 1; j < rows; j++) {{
                double *one = a + i * width, *other = a + j * width;
                double aa = 0.0, bb = 0.0, ab = 0.0, zeta, tangent, cosine, sine;
                for (k = 0; k < size; k++) {{
                    aa += one[k] * one[k];
                    bb += other[k] * other[k];
                    ab += one[k] * other[k];
                }}
                if (ab == 0.0 || fabs(ab) <= 1e-16 * sqrt(aa) * sqrt(bb))
                    continue;
                turned = 1;
                zeta = (bb - aa) / (2.0 * ab);
                tangent = (zeta < 0.0 ? -1.0 : 1.0) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                cosine = 1.0 / sqrt(1.0 + tangent * tangent);
                sine = cosine * tangent;
                for (k = 0; k < width; k++) {{
                    double first = one[k];
                    one[k] = cosine * first - sine * other[k];
                    other[k] = sine * first + cosine * other[k];
                }}
            }}
    }}
}}

static double norm_of(const double *a, int size)
{{
    double sum = 0.0;
    int k;

    for (k = 0; k < size; k++)
        sum += a[k] * a[k];
    return sqrt(sum);
}}

/*
 * Add to x the least solution of a x = b in the sense of least squares; the rows are NV numbers of a and one of b, and
 * singular values up to `zero` count as zero.
 */
static void add_least(double *a, int rows, double *x, double zero)
{{
    int i, k;

    orthogonalize(a, rows, NV, NV + 1);
    for (i = 0; i < rows; i++) {{
        const double *row = a + i * (NV + 1);
        double size = norm_of(row, NV);
        if (size > zero)
            for (k = 0; k < NV; k++)
                x[k] += row[k] * (row[NV] / size / size);
    }}
}}

/* Constraints in natural units; rows without a size are zero. */
static void natural_rows(double t, const double *q, const double *v, const double *g, double *sizes, double *natural)
{{
    int i, k;

    row_sizes(t, q, v, sizes);
    for (i = 0; i < ROWS; i++)
        for (k = 0; k < NV; k++)
            natural[i * NV + k] = sizes[i] > 0.0 ? g[k * ROWS + i] * scales[k] / sizes[i] : 0.0;
}}

static int is_closed(double t, const double *q, const double *v, const double *gaps)
{{
    double branches[BRANCHES + 1], sizes[ROWS];
    int i;

    row_sizes(t, q, v, sizes);
    for (i = 0; i < ROWS; i++)
        if (!(fabs(gaps[i]) <= {closed} * sizes[i]))
            return 0;
    branch_checks(t, q, v, branches);
    for (i = 0; i < BRANCHES; i++)
        if (!(branches[i] > 0.0))
            return 0;
    return 1;
}}

/* Move the coordinates that are not fixed as little as possible so that loops close. */
static int close_loops(double t, double *q, const double *v, const unsigned char *fixed)
{{
    double gaps[ROWS], next_gaps[ROWS], next_q[NQ], g[ROWS * NV], a[ROWS * (NV + 1)], move[NV];
    double natural[ROWS * NV], sizes[ROWS];
    int sweep, half, i, k;

    position(t, q, v, gaps);
    for (sweep = 0; sweep < {iterations}; sweep++) {{
        double norm = norm_of(gaps, ROWS), most = 0.0;
        if (norm == 0.0 || !isfinite(norm))
            break;
        gradient(t, q, v, g);
        natural_rows(t, q, v, g, sizes, natural);
        for (i = 0; i < ROWS; i++) {{
            for (k = 0; k < NV; k++)
                a[i * (NV + 1) + k] = holonomic[i] && !fixed[k] ? natural[i * NV + k] : 0.0;
            a[i * (NV + 1) + NV] = holonomic[i] && sizes[i] > 0.0 ? -gaps[i] / sizes[i] : 0.0;
        }}
        memset(move, 0, sizeof move);
        add_least(a, ROWS, move, {rank});
        for (k = 0; k < NV; k++)
            most = fmax(most, fabs(move[k]));
        for (k = 0; k < NV; k++)
            move[k] *= scales[k] * fmin(1.0, {longest} / fmax(most, 1e-300));
        for (half = 0; half < 12; half++) {{
            displaced(q, move, v, next_q);
            position(t, next_q, v, next_gaps);
            if (norm_of(next_gaps, ROWS) < norm)
                break;
            for (k = 0; k < NV; k++)
                move[k] *= 0.5;
        }}
        if (half == 12)
            break;
        memcpy(q, next_q, sizeof next_q);
        memcpy(gaps, next_gaps, sizeof gaps);
        if (norm_of(gaps, ROWS) > (1.0 - {stalled}) * norm)
            break;
    }}
    return is_closed(t, q, v, gaps);
}}

/* Whether any constraint restricts the speeds. */
static int restricts(double t, const double *q, const double *v)
{{
    double g[ROWS * NV], sizes[ROWS], natural[ROWS * NV];
    int i;

    gradient(t, q, v, g);
    natural_rows(t, q, v, g, sizes, natural);
    for (i = 0; i < ROWS; i++)
        if (norm_of(natural + i * NV, NV) > {rank})
            return 1;
    return 0;
}}

/* The principal axes of the mass matrix in natural units, each after itself times its inertia; the largest inertia. */
static double inertia_axes(double t, const double *q, const double *v, double *axes)
{{
    double mass[NV * NV], largest = 0.0;
    int i, k;

    mass_matrix(t, q, v, mass);
    for (i = 0; i < NV; i++)
        for (k = 0; k < NV; k++) {{
            axes[i * 2 * NV + k] = mass[k * NV + i] * scales[i] * scales[k];
            axes[i * 2 * NV + NV + k] = i == k ? 1.0 : 0.0;
        }}
    orthogonalize(axes, NV, NV, 2 * NV);
    for (i = 0; i < NV; i++)
        largest = fmax(largest, norm_of(axes + i * 2 * NV, NV));
    return largest;
}}

/* The speeds that satisfy the constraints with the least kinetic energy of the change from `old`; fixed ones stay. */
static int fit_speeds(
    double t, const double *q, double *u, const double *old, const double *v, const unsigned char *fixed)
{{
    double axes[NV * 2 * NV], g[ROWS * NV], b[ROWS], rows[(ROWS + NV) * NV], right[ROWS + NV];
    double a[(ROWS + NV) * (NV + 1)], change[NV], found[NV], along[NV], size, largest;
    double natural[ROWS * NV], sizes[ROWS], rate;
    int count = ROWS, i, j, k, sweep;

    gradient(t, q, v, g);
    natural_rows(t, q, v, g, sizes, natural);
    drift(t, q, v, b);
    rate_of_drives(t, q, v, &rate);
    largest = inertia_axes(t, q, v, axes);
    for (i = 0; i < ROWS; i++) {{
        right[i] = -b[i];
        for (k = 0; k < NV; k++) {{
            rows[i * NV + k] = g[k * ROWS + i];
            right[i] -= g[k * ROWS + i] * old[k];
        }}
    }}
    for (i = 0; i < NV; i++)
        if (fixed[i]) {{
            for (k = 0; k < NV; k++)
                rows[count * NV + k] = i == k ? 1.0 : 0.0;
            right[count++] = u[i] - old[i];
        }}
    memset(change, 0, sizeof change);
    for (sweep = 0; sweep < 2 && restricts(t, q, v); sweep++) {{
        for (i = 0; i < count; i++) {{
            double *row = a + i * (NV + 1), rest = right[i];
            for (j = 0; j < NV; j++) {{
                const double *axis = axes + j * 2 * NV;
                size = fmax(norm_of(axis, NV), 1e-12 * fmax(largest, 1e-300));
                row[j] = 0.0;
                for (k = 0; k < NV; k++)
                    row[j] += rows[i * NV + k] * scales[k] * axis[NV + k] / sqrt(size);
            }}
            for (k = 0; k < NV; k++)
                rest -= rows[i * NV + k] * change[k];
            size = i < ROWS && norm_of(natural + i * NV, NV) <= {rank} ? INFINITY : norm_of(row, NV);
            for (j = 0; j < NV; j++)
                row[j] /= size;
            row[NV] = rest / size;
        }}
        memset(along, 0, sizeof along);
        add_least(a, count, along, {rank});
        for (j = 0; j < NV; j++) {{
            const double *axis = axes + j * 2 * NV;
            size = fmax(norm_of(axis, NV), 1e-12 * fmax(largest, 1e-300));
            for (k = 0; k < NV; k++)
                change[k] += scales[k] * axis[NV + k] * along[j] / sqrt(size);
        }}
    }}
    for (k = 0; k < NV; k++)
        found[k] = fixed[k] ? u[k] : old[k] + change[k];
    for (k = 0; k < NV; k++)
        rate = fmax(rate, fabs(found[k]) / scales[k]);
    for (i = 0; i < ROWS; i++) {{
        double error = b[i];
        for (k = 0; k < NV; k++)
            error += rows[i * NV + k] * found[k];
        if (!(fabs(error) <= {consistent} * (sizes[i] * rate + fabs(b[i]))))
            return 0;
    }}
    memcpy(u, found, sizeof found);
    return 1;
}}"""

RESTING_SPEEDS = """\
/* The speeds of least kinetic energy beside the drives, without constraints. */
static void resting_speeds(double t, const double *q, const double *v, double *u)
{{
    double axes[NV * 2 * NV], p[NV], largest;
    int i, k;

    if (!restricts(t, q, v))
        return;
    momentum(t, q, v, p);
    largest = inertia_axes(t, q, v, axes);
    for (i = 0; i < NV; i++) {{
        const double *axis = axes + i * 2 * NV + NV;
        double size = norm_of(axes + i * 2 * NV, NV), along = 0.0;
        if (!(size > {weightless} * largest))
            continue;
        for (k = 0; k < NV; k++)
            along -= axis[k] * scales[k] * p[k] / size;
        for (k = 0; k < NV; k++)
            u[k] += scales[k] * axis[k] * along;
    }}
}}"""

START_OF_CONSTRAINED = """\
/* As the file with these parameters starts, then with the given values at the time t. */
static int assemble_given(double t, double *y, const double *in, const double *p, const unsigned char *given)
{{
    static const unsigned char none[NV];
    const double *v = in + {inputs};
    unsigned char fixed[NV], fixed_u[NV];
    double start[NQ + NV], q[NQ], u[NV], old[NV];
    int i, k, has = t != 0.0, closed;

    start_of(p, start);
    for (i = 0; i < NQ + NV; i++)
        has |= given && given[i];
    for (i = 0; i < NV; i++)
        u[i] = fixed_speeds[i] ? start[NQ + i] : 0.0;
    memset(old, 0, sizeof old);
    memcpy(q, start, sizeof q);
    closed = close_loops(0.0, q, v, fixed_in_assembly);
    resting_speeds(0.0, q, v, old);
    if (closed && fit_speeds(0.0, q, u, old, v, fixed_speeds))
        choose_branch(0.0, q, u, v, fixed_speeds);
    else if (!has)
        return closed ? -1 : 0;
    if (!closed)
        memcpy(q, start, sizeof q);
    if (has) {{
        for (i = 0; i < NQ; i++)
            q[i] = given && given[i] ? y[i] : q[i];
        for (i = 0; i < NV; i++) {{
            fixed_u[i] = given && given[NQ + i];
            u[i] = fixed_u[i] ? y[NQ + i] : u[i];
            fixed[i] = 0;
            for (k = 0; k < count_of[i]; k++)
                fixed[i] |= given && given[first_of[i] + k];
        }}
        memcpy(old, u, sizeof old);
        memcpy(start, q, sizeof q);
        if (!close_loops(t, q, v, fixed)) {{
            memcpy(q, start, sizeof q);
            if (!close_loops(t, q, v, none))
                return 0;
        }}
        if (!fit_speeds(t, q, u, old, v, fixed_u) && !fit_speeds(t, q, u, old, v, none))
            return -1;
        choose_branch(t, q, u, v, fixed_u);
    }}
    memcpy(y, q, sizeof q);
    memcpy(y + NQ, u, sizeof u);
    return 1;
}}"""
