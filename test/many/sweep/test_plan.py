import numpy as np
import pytest

from mbd_sim.base.errors import CommandError
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.plan import Grid, Random, plan, variation


@pytest.fixture(scope="module")
def rods():
    return load_mechanism("double_rod")


def test_variations_are_read_with_units(rods):
    assert variation("l=0.5:2:4", rods) == Grid("l", (0.5, 1.0, 1.5, 2.0))
    assert variation("joints.elbow.position = 0 deg, 180 deg", rods) == Grid("joints.elbow.position", (0.0, np.pi))
    assert variation("m=uniform(500 g, 2*m)", rods) == Random("m", "uniform", 0.5, 2.0)
    assert variation("efforts.elbow=1e0", rods) == Grid("efforts.elbow", (1.0,))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("l", "gives no values"),
        ("l=", "gives no values"),
        ("l=1:2", "START:STOP:COUNT"),
        ("l=1:2:x", "the number of values cannot be 'x'"),
        ("l=a,b", "'a' .*unknown"),
        ("l=gauss(1, 2)", "no distribution 'gauss'"),
        ("l=uniform(1)", "low, high"),
        ("joints.elbow.damping=0.1,1 kg", "'1 kg' the unit 'kg' does not fit"),
        ("joints.elbow.position=uniform(1 m, 2 m)", "the unit 'm' does not fit"),
        ("efforts.elbow=0,3 N", r"'3 N' the unit 'N' does not fit: a value in N\*m is expected here"),
        ("l=uniform(2, 1)", "uniform needs low <= high"),
        ("l=uniform(0, inf)", "must be finite"),
        ("l=loguniform(-1, 2)", "0 < low"),
        ("l=normal(1, -2)", "must not be negative"),
        ("joints.elbw.damping=1", "elbow"),
        ("joints.elbow.type=1", "not a number"),
        ("efforts.elbw=1", "no joint 'elbw'"),
    ],
)
def test_the_error_for_a_value_that_cannot_be_varied_says_why(rods, text, words):
    with pytest.raises(CommandError, match=words):
        variation(text, rods)


def test_a_plan_has_every_combination_with_new_random_values(rods):
    planned = plan(
        [Grid("l", (1.0, 2.0)), Random("m", "uniform", 0.0, 1.0), Grid("k", (3.0, 4.0, 5.0))], draws=2, seed=1
    )
    assert planned.names == ("l", "m", "k")
    assert planned.values.shape == (12, 3)
    assert planned.values[:, 0].tolist() == [1.0] * 6 + [2.0] * 6
    assert planned.values[:6, 2].tolist() == [3.0, 3.0, 4.0, 4.0, 5.0, 5.0]
    assert len(set(planned.values[:, 1])) == 12
    assert np.array_equal(
        planned.values,
        plan([Grid("l", (1.0, 2.0)), Random("m", "uniform", 0.0, 1.0), Grid("k", (3.0, 4.0, 5.0))], 2, 1).values,
    )
    assert planned.changes(3, 4) == [dict(zip(planned.names, planned.values[3], strict=True))]


def test_laws_draw_what_they_say():
    drawn = plan([Random("a", "normal", 2.0, 0.5), Random("b", "loguniform", 1.0, 100.0)], draws=20_000).values
    assert drawn[:, 0].mean() == pytest.approx(2.0, abs=0.02)
    assert drawn[:, 0].std() == pytest.approx(0.5, abs=0.02)
    assert np.log10(drawn[:, 1]).mean() == pytest.approx(1.0, abs=0.02)
    assert drawn[:, 1].min() >= 1.0
    assert drawn[:, 1].max() <= 100.0


def test_a_plan_is_not_too_large_and_varies_nothing_twice():
    for other in ("l", "parameters.l"):
        with pytest.raises(CommandError, match="l is varied twice"):
            plan([Grid("l", (1.0,)), Grid(other, (2.0,))])
    with pytest.raises(CommandError, match="the number of runs must be"):
        plan([Grid("l", (1.0,) * 5000), Grid("m", (1.0,) * 5000)])
    with pytest.raises(CommandError, match="the number of runs must be"):
        plan([Grid("l", (1.0,))], draws=0)
