"""The cost of a step: the scalar instructions of the compiled functions, counted by kind."""

from __future__ import annotations

from collections import Counter
from typing import Any

import casadi as ca

from mbd_sim.compiler.lists.instruction_list import MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT, InstructionList
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import Equations
from mbd_sim.integrators.method import Method

_KINDS = {
    "additions": (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE),
    "multiplications": (ca.OP_MUL, ca.OP_SQ),
    "fused of both": (MULTIPLY_ADD, MULTIPLY_SUBTRACT, SUBTRACT_PRODUCT),
    "divisions": (ca.OP_DIV, ca.OP_INV),
    "roots": (ca.OP_SQRT,),
    "sines and cosines": (ca.OP_SIN, ca.OP_COS),
}
_TITLES = {"fused of both": "fused multiply-add"}  # columns whose title differs from their key
_FREE = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)


def cost(equations: Equations, method: Method) -> dict[str, Any]:
    """The instructions of one evaluation of the accelerations, of one projection onto the constraints, and of a step.

    A step takes `evaluations` of the accelerations and one projection; implicit methods take more instructions, and so
    do Adams methods where the motion is not smooth. Of a Taylor method, this is a step that has no expansion.
    """
    evaluations = method.evaluations
    accelerations = _counted(arranged(equations.rates))
    projection = _counted(arranged(equations.project, fused=False)) if equations.project is not None else {}
    return {
        "accelerations": accelerations,
        "back_to_constraints": projection,
        "evaluations": evaluations,
        "step": evaluations * sum(accelerations.values()) + sum(projection.values()),
    }


def cost_text(found: dict[str, Any]) -> str:
    """The result of `cost` as a table."""
    columns = [*_KINDS, "others"]
    lines = [f"{'instructions':22s}" + "".join(f"{_TITLES.get(name, name):>19s}" for name in ("all", *columns))]
    for key, name in (("accelerations", "accelerations"), ("back_to_constraints", "projection")):
        if found[key]:
            counts = (sum(found[key].values()), *(found[key][kind] for kind in columns))
            lines.append(f"{name:22s}" + "".join(f"{count:19d}" for count in counts))
    lines.append(f"{'one step':22s}{found['step']:19d}  ({found['evaluations']} evaluations of the accelerations)")
    return "\n".join(lines)


def _counted(program: InstructionList) -> dict[str, int]:
    of_kind = {operation: kind for kind, operations in _KINDS.items() for operation in operations}
    operations = (program.instruction_id(index) for index in range(program.n_instructions()))
    counts = Counter(of_kind.get(operation, "others") for operation in operations if operation not in _FREE)
    return {kind: counts[kind] for kind in (*_KINDS, "others")}
