"""Sine and cosine as C text, with the same operations as `mbd_sim.compiler.trigonometry` and so the same bits."""

from __future__ import annotations

from mbd_sim.compiler import trigonometry as t

_TEXT = """\
/*
 * Sine and cosine of an angle in rad. Polynomials and reduction are those of FDLIBM (Sun Microsystems, k_sin.c,
 * k_cos.c, e_rem_pio2.c), with fused multiply-adds; the error is below 0.8 units in the last place. The C library is
 * called only for angles beyond {LARGEST} rad.
 */
static void sine_cosine(double x, double *sine, double *cosine)
{{
    double quarters, head, second, tail, r, lost, rest, z, w, half, first, s, c, swapped;
    int64_t quadrant;

    if (!(fabs(x) < {LARGEST})) {{
        *sine = sin(x);
        *cosine = cos(x);
        return;
    }}
    /* x = quarters * pi/2 + r - rest: adding 1.5 * 2^52 rounds to the nearest integer. */
    quarters = fma(x, {TWO_OVER_PI}, {ROUNDER}) - {ROUNDER};
    quadrant = (int64_t)quarters;
    head = fma(quarters, -{HALF_PI}, x);
    second = quarters * {HALF_PI_NEXT};
    tail = fma(quarters, {HALF_PI_TAIL}, second);
    r = head - tail;
    lost = fma(quarters, {HALF_PI_TAIL}, second - tail);
    rest = fma(quarters, {HALF_PI_LAST}, lost) - ((head - r) - tail);

    z = r * r;
    w = z * z;
    half = -0.5 * z;
    s = fma(w, fma(w, fma(z, {s5}, {s4}), fma(z, {s3}, {s2})), fma(z, {s1}, {s0}));
    s = r - fma(z * r, s, fma(half, rest, rest));
    c = fma(w, fma(w, fma(z, {c5}, {c4}), fma(z, {c3}, {c2})), fma(z, {c1}, {c0}));
    first = fma(-0.5, z, 1.0);
    c = first + fma(w, c, fma(r, rest, fma(-0.5, z, 1.0 - first)));

    if (quadrant & 1) {{
        swapped = s;
        s = c;
        c = swapped;
    }}
    *sine = quadrant & 2 ? -s : s;
    *cosine = (quadrant + 1) & 2 ? -c : c;
}}
"""


def sine_cosine_text() -> str:
    """The definition of `static void sine_cosine(double x, double *sine, double *cosine)`."""
    names = ("LARGEST", "TWO_OVER_PI", "ROUNDER", "HALF_PI", "HALF_PI_NEXT", "HALF_PI_TAIL", "HALF_PI_LAST")
    values = {name: repr(vars(t)[name]) for name in names}
    for letter, coefficients in (("s", t.SINE), ("c", t.COSINE)):
        values |= {f"{letter}{index}": repr(value) for index, value in enumerate(coefficients)}
    return _TEXT.format(**values)
