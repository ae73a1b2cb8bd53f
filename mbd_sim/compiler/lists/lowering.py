"""Instruction lists, CasADi's or arranged ones, to LLVM IR: one scalar instruction each, in the same order.

There are two exceptions. Divisions by the same number become one reciprocal and products, as a division costs as
much as some ten of them. Sines and cosines of inputs are computed several at a time, see `angle_groups`.

No flag allows LLVM to reassociate or contract, so that the same list gives the same bits on every machine. Sums and
products are rearranged and fused in the list itself, by `mbd_sim.compiler.lists.schedule`.

Long lists are split into several functions, as compile time grows with the square of a function's length. The
derivative of 30 rods, 110,000 instructions, compiles in 60 s as one function and in 6 s split; it runs as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, IRBuilder, element, local_array, number
from mbd_sim.compiler.ir.lanes import LaneBuilder, new_builder
from mbd_sim.compiler.ir.module import ALWAYS_INLINE, POINTER, VOID, Function, FunctionType, Module, Value
from mbd_sim.compiler.ir.trigonometry import sine_cosine
from mbd_sim.compiler.lists.instruction_list import (
    MULTIPLY_ADD,
    MULTIPLY_SUBTRACT,
    SUBTRACT_PRODUCT,
    Instruction,
    Instructions,
    instructions_of,
)
from mbd_sim.compiler.lists.packing import Component, angle_groups, vector_size

PIECE = 4000  # instructions of one function
UNSPLIT = 8000  # instructions up to which a list stays one function


def pieces(count: int) -> Sequence[range]:
    """The ranges of instructions that become functions, in order."""
    if count <= UNSPLIT:
        return [range(count)]
    return [range(first, min(first + PIECE, count)) for first in range(0, count, PIECE)]


def live_out(instructions: Sequence[Instruction], split: Sequence[range]) -> list[set[int]]:
    """The indices in the work vector that each piece sets and a later one reads."""
    needed: set[int] = set()
    found = []
    for piece in reversed(split):
        after, needed = needed, set(needed)
        defined = set()
        for index in reversed(piece):
            operation, source, target, _ = instructions[index]
            if operation != ca.OP_OUTPUT:
                defined.add(target[0])
                needed.discard(target[0])
            if operation not in (ca.OP_INPUT, ca.OP_CONST):
                needed.update(source)
        found.append(after & defined)
    return found[::-1]


class PieceWork(dict[int, Value]):
    """The work vector within a piece: values that the piece has not set are loaded from memory."""

    def __init__(self, builder: IRBuilder, memory: Value) -> None:
        super().__init__()
        self._builder, self._memory = builder, memory

    def __missing__(self, index: int) -> Value:
        self[index] = self._builder.load(element(self._builder, self._memory, index), typ=DOUBLE)
        return self[index]

    def save(self, indices: set[int]) -> None:
        """Store some values to memory, for later pieces."""
        for index in sorted(indices):
            self._builder.store(self[index], element(self._builder, self._memory, index))


Build = Callable[["Lowering", Value], Value]
Build2 = Callable[["Lowering", Value, Value], Value]
Build3 = Callable[["Lowering", Value, Value, Value], Value]

_UNARY: dict[int, Build] = {
    ca.OP_ASSIGN: lambda low, x: x,
    ca.OP_NEG: lambda low, x: low.builder.fneg(x),
    ca.OP_SQ: lambda low, x: low.builder.fmul(x, x),
    ca.OP_TWICE: lambda low, x: low.builder.fadd(x, x),
    ca.OP_INV: lambda low, x: low.builder.fdiv(number(1.0), x),
    ca.OP_SQRT: lambda low, x: low.builder.intrinsic("llvm.sqrt", x),
    ca.OP_FABS: lambda low, x: low.builder.intrinsic("llvm.fabs", x),
    ca.OP_SIGN: lambda low, x: low.sign(x),
    ca.OP_FLOOR: lambda low, x: low.builder.intrinsic("llvm.floor", x),
    ca.OP_SIN: lambda low, x: low.sine_cosine(x)[0],
    ca.OP_COS: lambda low, x: low.sine_cosine(x)[1],
    ca.OP_NOT: lambda low, x: low.truth(low.builder.fcmp_ordered("==", x, number(0.0))),
}
_BINARY: dict[int, Build2] = {
    ca.OP_ADD: lambda low, x, y: low.builder.fadd(x, y),
    ca.OP_SUB: lambda low, x, y: low.builder.fsub(x, y),
    ca.OP_MUL: lambda low, x, y: low.builder.fmul(x, y),
    ca.OP_DIV: lambda low, x, y: low.builder.fdiv(x, y),
    ca.OP_FMIN: lambda low, x, y: low.select("<", x, y),
    ca.OP_FMAX: lambda low, x, y: low.select(">", x, y),
    ca.OP_LT: lambda low, x, y: low.truth(low.builder.fcmp_ordered("<", x, y)),
    ca.OP_LE: lambda low, x, y: low.truth(low.builder.fcmp_ordered("<=", x, y)),
    ca.OP_EQ: lambda low, x, y: low.truth(low.builder.fcmp_ordered("==", x, y)),
    ca.OP_NE: lambda low, x, y: low.truth(low.builder.fcmp_unordered("!=", x, y)),
    ca.OP_IF_ELSE_ZERO: lambda low, x, y: low.if_else_zero(x, y),
}
_TERNARY: dict[int, Build3] = {
    MULTIPLY_ADD: lambda low, x, y, z: low.builder.fma(x, y, z),
    MULTIPLY_SUBTRACT: lambda low, x, y, z: low.builder.fma(x, y, low.builder.fneg(z)),
    SUBTRACT_PRODUCT: lambda low, x, y, z: low.builder.fma(low.builder.fneg(x), y, z),
}
SINES = frozenset({ca.OP_SIN, ca.OP_COS})
# Instructions of a function up to which sines are inlined. In longer ones, such as those of more than ten rods, calls
# save half of the compilation, and as the code is shorter, some percent of each step.
INLINE_SINES = 1000
# Nearly half of the instructions of a long function keep values on the stack. Their addresses are one byte shorter from
# the frame pointer than from the stack pointer, and a processor decodes only a few bytes in a cycle. LLVM uses the
# frame pointer only if it need not align the stack for vectors of four.
SHORT_ADDRESSES = ('"frame-pointer"="all"', '"no-realign-stack"')
# Functions of the C library, on which their last bits depend. Only expressions, friction and powers need them.
LIBRARY: dict[int, str] = {
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_TANH: "tanh",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_ATAN2: "atan2",
}


def lower(
    module: Module, function: Instructions, inline: bool, lanes: int = 1, *, as_interpreted: bool = False
) -> Function:
    """Emit `function` as `void name(double* in0, …, double* out0, …)`, whose arguments must not overlap.

    With several `lanes` each double is a vector, see `LaneBuilder`.

    :param as_interpreted: results have the bits that CasADi's interpreter computes.

    :raises NotImplementedError: the function has an operation that kernels do not support.
    """
    inputs, outputs = function.n_in(), function.n_out()
    emitted, builder = define(module, function.name(), inputs + outputs, inline, lanes)
    instructions = instructions_of(function)
    split = pieces(len(instructions))
    by_reciprocal = frozenset[int]() if as_interpreted else shared_divisions(instructions)
    inline_sines = len(instructions) <= INLINE_SINES
    if len(split) == 1:
        arguments = emitted.args[:inputs], emitted.args[inputs:]
        Lowering(module, builder, inline_sines, as_interpreted).run(
            instructions, by_reciprocal, split[0], *arguments, {}
        )
    else:
        memory = local_array(builder, function.sz_w())
        for piece_number, (piece, saved) in enumerate(zip(split, live_out(instructions, split), strict=True)):
            part, inside = define(module, f"{function.name()}.{piece_number}", inputs + outputs + 1, False, lanes)
            piece_work = PieceWork(inside, part.args[-1])
            arguments = part.args[:inputs], part.args[inputs:-1]
            Lowering(module, inside, inline_sines, as_interpreted).run(
                instructions, by_reciprocal, piece, *arguments, piece_work
            )
            piece_work.save(saved)
            inside.ret_void()
            builder.call(part, [*emitted.args, memory])
    builder.ret_void()
    return emitted


def export(module: Module, name: str, function: Function, attributes: Sequence[str] = ()) -> None:
    """Export a function of the module under a name."""
    exported = Function(module, FunctionType(VOID, [POINTER] * len(function.args)), name)
    exported.attributes = [*attributes]
    builder = IRBuilder(exported.append_basic_block("entry"))
    builder.call(function, exported.args)
    builder.ret_void()


def define(module: Module, name: str, arguments: int, inline: bool, lanes: int) -> tuple[Function, IRBuilder]:
    """A function of this number of addresses that do not overlap, and a builder of it."""
    function = Function(module, FunctionType(VOID, [POINTER] * arguments), name)
    function.linkage = "internal"
    function.attributes = [ALWAYS_INLINE if inline else "noinline", "nounwind", *SHORT_ADDRESSES]
    function.noalias = True
    return function, new_builder(function.append_basic_block("entry"), lanes)


class Lowering:
    """The emission of a list of instructions, with the values that are computed once and used again."""

    def __init__(self, module: Module, builder: IRBuilder, inline: bool, as_interpreted: bool = False) -> None:
        self.module, self._inline, self._as_interpreted = module, inline, as_interpreted
        self.builder: IRBuilder = builder
        self._sines_cosines: dict[Value | Component, tuple[Value, Value]] = {}  # by angle
        self._components: dict[Value, Component] = {}  # of inputs that are angles
        self._groups: Mapping[Component, Sequence[Component]] = {}
        self._reciprocals: dict[Value, Value] = {}  # by divisor

    def run(
        self,
        instructions: Sequence[Instruction],
        by_reciprocal: frozenset[int],
        piece: range,
        inputs: Sequence[Value],
        outputs: Sequence[Value],
        work: dict[int, Value],
    ) -> None:
        """Emit a range of the instructions; `work` is the work vector."""
        if self.module.fast and not isinstance(self.builder, LaneBuilder) and not self._as_interpreted:
            self._groups = angle_groups(instructions, piece)
        for index in piece:
            operation, source, target, value = instructions[index]
            if operation == ca.OP_INPUT:
                work[target[0]] = self._input(inputs, source)
            elif operation in SINES and work[source[0]] in self._components:
                work[target[0]] = self._sine_or_cosine(operation, work[source[0]], inputs)
            elif operation == ca.OP_OUTPUT:
                self.builder.store(work[source[0]], element(self.builder, outputs[target[0]], target[1]))
            elif operation == ca.OP_CONST:
                work[target[0]] = number(value)
            elif index in by_reciprocal:
                inverse = self.reciprocal(work[source[0 if operation == ca.OP_INV else 1]])
                inverted = operation == ca.OP_INV
                work[target[0]] = inverse if inverted else self.builder.fmul(work[source[0]], inverse)
            else:
                work[target[0]] = self.operation(operation, *[work[index] for index in source])

    def operation(self, operation: int, *operands: Value) -> Value:
        """Emit an operation that is not a load, a store or a constant.

        :raises NotImplementedError: kernels do not support it.
        """
        if operation in _UNARY:
            return _UNARY[operation](self, *operands)
        if operation in _BINARY:
            return _BINARY[operation](self, *operands)
        if operation in _TERNARY:
            return _TERNARY[operation](self, *operands)
        if operation in LIBRARY:
            return self.library(LIBRARY[operation], *operands)
        raise NotImplementedError(f"no kernel instruction for CasADi operation {operation}")

    def library(self, name: str, *arguments: Value) -> Value:
        """Call a function of the C library, in each lane."""
        function = self.module.declared(name, DOUBLE, [DOUBLE] * len(arguments))
        b = self.builder
        if isinstance(b, LaneBuilder) and any(argument.type != DOUBLE for argument in arguments):
            wide = [b.widened(argument) for argument in arguments]
            return b.gathered([b.call(function, [b.lane(a, index) for a in wide]) for index in range(b.lanes)])
        return b.call(function, arguments)

    def sign(self, x: Value) -> Value:
        """-1, 0 or 1 as CasADi defines it, and nan for nan."""
        above = self.truth(self.builder.fcmp_ordered(">", x, number(0.0)))
        below = self.truth(self.builder.fcmp_ordered("<", x, number(0.0)))
        value = self.builder.fsub(above, below)
        return self.builder.select(self.builder.fcmp_unordered("uno", x, x), x, value)

    def _input(self, inputs: Sequence[Value], component: Component) -> Value:
        """Load a component of an argument."""
        value = self.builder.load(element(self.builder, inputs[component[0]], component[1]), typ=DOUBLE)
        if component in self._groups:
            self._components[value] = component
        return value

    def _sine_or_cosine(self, operation: int, angle: Value, inputs: Sequence[Value]) -> Value:
        """The sine or the cosine of an input that belongs to a group, computed with all others of the group."""
        component = self._components[angle]
        if component not in self._sines_cosines:
            group = self._groups[component]
            angles = [angle if each == component else self._input(inputs, each) for each in group]
            lanes = vector_size(len(group))
            wide = LaneBuilder(self.builder.block, lanes)
            vector = wide.gathered(angles + angles[-1:] * (lanes - len(angles)))
            sines, cosines = sine_cosine(self.module, wide, vector, self._inline)
            for lane, each in enumerate(group):
                self._sines_cosines[each] = wide.lane(sines, lane), wide.lane(cosines, lane)
        return self._sines_cosines[component][operation == ca.OP_COS]

    def sine_cosine(self, angle: Value) -> tuple[Value, Value]:
        """Sine and cosine of an angle, computed once."""
        if angle not in self._sines_cosines and self._as_interpreted:
            self._sines_cosines[angle] = self.library("sin", angle), self.library("cos", angle)
        elif angle not in self._sines_cosines:
            self._sines_cosines[angle] = sine_cosine(self.module, self.builder, angle, self._inline)
        return self._sines_cosines[angle]

    def reciprocal(self, divisor: Value) -> Value:
        """1 / divisor, computed once."""
        if divisor not in self._reciprocals:
            self._reciprocals[divisor] = self.builder.fdiv(number(1.0), divisor)
        return self._reciprocals[divisor]

    def select(self, order: str, x: Value, y: Value) -> Value:
        """The lesser or the greater of two values."""
        return self.builder.select(self.builder.fcmp_ordered(order, x, y), x, y)

    def truth(self, condition: Value) -> Value:
        """1 where a condition holds, otherwise 0."""
        return self.builder.select(condition, number(1.0), number(0.0))

    def if_else_zero(self, condition: Value, value: Value) -> Value:
        """A value where a condition is not 0, otherwise 0."""
        return self.builder.select(self.builder.fcmp_unordered("!=", condition, number(0.0)), value, number(0.0))


def shared_divisions(instructions: Sequence[Instruction]) -> frozenset[int]:
    """The instructions that divide by a number by which another instruction divides too."""
    source_of: dict[int, int] = {}  # for each entry of the work vector, the instruction that set it
    divisions: dict[int, list[int]] = {}
    for index, (operation, source, target, _) in enumerate(instructions):
        if operation in (ca.OP_DIV, ca.OP_INV):
            divisions.setdefault(source_of[source[-1]], []).append(index)
        if operation != ca.OP_OUTPUT:
            source_of[target[0]] = index
    return frozenset(index for group in divisions.values() if len(group) > 1 for index in group)


def instruction_count(function: Instructions) -> int:
    """The number of scalar instructions of a function, without loads and stores."""
    skipped = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    return sum(instruction.operation not in skipped for instruction in instructions_of(function))
