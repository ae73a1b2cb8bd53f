"""Functions of CasADi in which equal operations are done once."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

# Instructions from which on CasADi does not look for equal operations. That takes 6 µs an instruction, a tenth of the
# time of a first build of a humanoid, and leaves out 2 to 5 % of them: those that the compiler arranges or optimizes it
# merges itself. In short functions CasADi also simplifies what it has merged, which leaves out up to a sixth.
LONG = 4000


def merged_function(name: str, inputs: Sequence[ca.SX], *outputs: ca.SX) -> ca.Function:
    """A function with dense outputs, which does equal operations once if it is not long."""
    arguments = name, list(inputs), [ca.densify(output) for output in outputs]
    function = ca.Function(*arguments)
    return function if function.n_instructions() >= LONG else ca.Function(*arguments, {"cse": True})
