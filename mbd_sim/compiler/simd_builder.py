"""Code for several members at once: a builder whose doubles are vectors, with one lane for each member.

The emitters emit the same instructions for one member and for many. A value that differs between members is a vector. A
value that is the same for all of them, such as the time or a coefficient of the method, is a scalar until it is
combined with a vector. Each lane takes the same IEEE operations in the same order as a single member, and so gets the
same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import llvmlite.ir as ir

from mbd_sim.compiler.ir_types import DOUBLE

ALIGNMENT = 8  # bytes, of the arrays of members


class LaneBuilder(ir.IRBuilder):  # type: ignore[misc]  # llvmlite carries no types
    """An `IRBuilder` that emits code for `lanes` members at once."""

    def __init__(self, block: ir.Block, lanes: int) -> None:
        super().__init__(block)
        self.lanes = lanes

    def vector(self, scalar: ir.Type) -> ir.VectorType:
        """The vector type with one scalar for each member."""
        return ir.VectorType(scalar, self.lanes)

    def widened(self, value: ir.Value) -> ir.Value:
        """The value as a vector: a scalar is copied to every lane."""
        if isinstance(value.type, ir.VectorType):
            return value
        wide = self.vector(value.type)
        if isinstance(value, ir.Constant):
            return ir.Constant(wide, [value] * self.lanes)
        undefined = ir.Constant(wide, ir.Undefined)
        first = self.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
        return self.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), None))

    def any_lane(self, condition: ir.Value) -> ir.Value:
        """Whether a condition holds for any member."""
        bits = self.bitcast(condition, ir.IntType(self.lanes))
        return self.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(self.lanes), 0))

    def lane(self, vector: ir.Value, index: int) -> ir.Value:
        """The value of one member."""
        return self.extract_element(vector, ir.Constant(ir.IntType(32), index))

    def gathered(self, values: Sequence[ir.Value]) -> ir.Value:
        """A vector of the values of the members."""
        vector: ir.Value = ir.Constant(self.vector(values[0].type), ir.Undefined)
        for index, value in enumerate(values):
            vector = self.insert_element(vector, value, ir.Constant(ir.IntType(32), index))
        return vector

    def _alike(self, *values: ir.Value) -> list[ir.Value]:
        """The values, all as vectors if one of them is a vector."""
        wide = any(isinstance(value.type, ir.VectorType) for value in values)
        return [self.widened(value) for value in values] if wide else list(values)

    def fcmp_ordered(self, order: str, x: ir.Value, y: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        """Compare; false for operands that are not numbers."""
        return super().fcmp_ordered(order, *self._alike(x, y), *rest, **more)

    def fcmp_unordered(self, order: str, x: ir.Value, y: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        """Compare; true for operands that are not numbers."""
        return super().fcmp_unordered(order, *self._alike(x, y), *rest, **more)

    def select(self, condition: ir.Value, x: ir.Value, y: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        """Select by a condition, for each member or for all."""
        if isinstance(condition.type, ir.VectorType):
            return super().select(condition, self.widened(x), self.widened(y), *rest, **more)
        return super().select(condition, *self._alike(x, y), *rest, **more)

    def fma(self, x: ir.Value, y: ir.Value, z: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        """Compute x y + z, rounded once."""
        x, y, z = self._alike(x, y, z)
        if not isinstance(x.type, ir.VectorType):
            return super().fma(x, y, z, *rest, **more)
        return super().call(self._wide_intrinsic("llvm.fma", 3), [x, y, z])

    def bitcast(self, value: ir.Value, type_: ir.Type, *rest: Any, **more: Any) -> ir.Value:
        """The same bits as another type."""
        keeps_lanes = isinstance(value.type, ir.VectorType) and type_ in (DOUBLE, ir.IntType(64))
        return super().bitcast(value, self.vector(type_) if keeps_lanes else type_, *rest, **more)

    def trunc(self, value: ir.Value, type_: ir.Type, *rest: Any, **more: Any) -> ir.Value:
        """The low bits of an integer."""
        wide = isinstance(value.type, ir.VectorType)
        return super().trunc(value, self.vector(type_) if wide else type_, *rest, **more)

    def load(self, pointer: ir.Value, *rest: Any, typ: ir.Type | None = None, **more: Any) -> ir.Value:
        """Load; a double is loaded for each member."""
        if typ == DOUBLE:
            return super().load(pointer, *rest, typ=self.vector(DOUBLE), align=ALIGNMENT, **more)
        return super().load(pointer, *rest, typ=typ, **more)

    def store(self, value: ir.Value, pointer: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        """Store; a scalar double is stored for each member."""
        wide = self.widened(value) if value.type == DOUBLE else value
        return super().store(wide, pointer, align=ALIGNMENT)

    def gep(self, pointer: ir.Value, indices: Any, *rest: Any, source_etype: ir.Type, **more: Any) -> ir.Value:
        """An address in an array; an element of an array of doubles has one double for each member."""
        step = self.vector(DOUBLE) if source_etype == DOUBLE else source_etype
        return super().gep(pointer, indices, *rest, source_etype=step, **more)

    def alloca(self, type_: ir.Type, *rest: Any, **more: Any) -> ir.Value:
        """Allocate on the stack; a double is allocated for each member."""
        return super().alloca(self.vector(DOUBLE) if type_ == DOUBLE else type_, *rest, **more)

    def call(self, function: ir.Function, arguments: Sequence[ir.Value], *rest: Any, **more: Any) -> ir.Value:
        """Call a function; an intrinsic for doubles is replaced by that for vectors."""
        if function.name.endswith(".f64") and function.name.startswith("llvm."):
            arguments = self._alike(*arguments)
            if isinstance(arguments[0].type, ir.VectorType):
                function = self._wide_intrinsic(function.name.removesuffix(".f64"), len(arguments))
        return super().call(function, arguments, *rest, **more)

    def _wide_intrinsic(self, name: str, arguments: int) -> ir.Function:
        wide, name = self.vector(DOUBLE), f"{name}.v{self.lanes}f64"
        if name in self.module.globals:
            return self.module.get_global(name)
        return ir.Function(self.module, ir.FunctionType(wide, [wide] * arguments), name)


def _widening(name: str) -> Any:
    """A method of `IRBuilder` with two operands, for `LaneBuilder`."""
    plain = getattr(ir.IRBuilder, name)

    def emit(self: LaneBuilder, x: ir.Value, y: ir.Value, *rest: Any, **more: Any) -> ir.Value:
        return plain(self, *self._alike(x, y), *rest, **more)

    return emit


for _name in ("fadd", "fsub", "fmul", "fdiv", "add", "and_", "or_", "xor", "shl"):
    setattr(LaneBuilder, _name, _widening(_name))


def new_builder(block: ir.Block, lanes: int) -> ir.IRBuilder:
    """A builder for `lanes` members at once; for 1, the builder of scalars."""
    return LaneBuilder(block, lanes) if lanes > 1 else ir.IRBuilder(block)


def lanes_of(builder: ir.IRBuilder) -> int:
    """The number of members for which a builder emits code."""
    return builder.lanes if isinstance(builder, LaneBuilder) else 1
