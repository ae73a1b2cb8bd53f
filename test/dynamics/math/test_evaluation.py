"""Functions of numbers, which keep the memory of their arguments and results."""

import threading

import casadi as ca
import numpy as np
import pytest

from mbd_sim.dynamics.math.expressions import all_evaluated, evaluated


def function():
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 3)
    return ca.Function("f", [t, x, ca.SX(0, 0)], [ca.densify(t * x @ x.T[:2]), ca.densify(ca.sum1(x)), ca.SX(0, 2)])


def test_the_results_are_those_of_a_call_and_stay_when_the_function_is_called_again():
    f, x = function(), np.array([1.0, -2.0, 3.0])
    outer, total, nothing = all_evaluated(f, 2.0, x[:, None], np.zeros(0))
    evaluated(f, 5.0, 7.0 * x, np.zeros(0))
    np.testing.assert_array_equal(outer, 2.0 * np.outer(x, x[:2]))
    np.testing.assert_array_equal(total, [[2.0]])
    assert nothing.shape == (0, 2) and outer.flags.c_contiguous and x.tolist() == [1.0, -2.0, 3.0]


@pytest.mark.parametrize(
    "arguments", [(2.0, np.ones(2), np.zeros(0)), (2.0, np.ones(3)), (np.ones(3), 2.0, np.zeros(0))]
)
def test_arguments_of_another_size_are_refused(arguments):
    with pytest.raises(ValueError, match="do not have the sizes"):
        all_evaluated(function(), *arguments)


def test_threads_do_not_share_memory():
    f, wrong = function(), []

    def call(scale):
        x = scale * np.ones(3)
        wrong.extend(k for k in range(300) if evaluated(f, 1.0, x, np.zeros(0))[2, 1] != scale * scale)

    threads = [threading.Thread(target=call, args=(scale,)) for scale in (1.0, 2.0, 3.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
