"""Lists of scalar operations: the components that they pass on, and lists that leave those as they are."""

import casadi as ca
import numpy as np

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.lists.instruction_list import passed_on
from mbd_sim.compiler.lists.lowering import export, lower
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import function_of_addresses


def test_components_that_are_passed_on_can_be_left_as_they_are():
    t, y = ca.SX.sym("t"), ca.SX.sym("y", 5)
    moved = ca.vertcat(y[0], y[1] * y[2], y[2], y[1], y[4] + 0 * t)
    program = arranged(ca.Function("move", [t, y], [moved, y]))
    assert passed_on(program, 1) == {0, 2, 4}
    assert passed_on(program, 0) == set()
    module = new_module()
    export(module, "moved", lower(module, program.without({0, 2, 4}), inline=True))
    code = compile_module(module)
    call = function_of_addresses(code.address("moved"), 4)
    time, given = np.zeros(1), np.arange(5.0) + 2.0
    first, second = np.full(5, -1.0), np.full(5, -1.0)
    call(*[array.ctypes.data for array in (time, given, first, second)])
    assert first.tolist() == [-1.0, 12.0, -1.0, 3.0, -1.0]
    assert second.tolist() == given.tolist()
