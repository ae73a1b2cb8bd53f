"""Code for several members at once: a builder whose doubles are vectors, with one lane for each member.

The emitters emit the same instructions for one member and for many. A value that differs between members is a vector. A
value that is the same for all of them, such as the time or a coefficient of the method, is a scalar until it is
combined with a vector. Each lane takes the same IEEE operations in the same order as a single member, and so gets the
same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbd_sim.compiler.ir.builder import DOUBLE, IRBuilder
from mbd_sim.compiler.ir.module import (
    BasicBlock,
    Type,
    Value,
    is_vector,
    scalar_of,
    undefined,
    vector_of,
    with_lanes_of,
)

ALIGNMENT = 8  # bytes, of the arrays of members


class LaneBuilder(IRBuilder):
    """An `IRBuilder` that emits code for `lanes` members at once."""

    def __init__(self, block: BasicBlock, lanes: int) -> None:
        super().__init__(block)
        self.lanes = lanes

    def widened(self, value: Value) -> Value:
        """The value as a vector: a scalar is copied to every lane."""
        if is_vector(value.type):
            return value
        wide = vector_of(value.type, self.lanes)
        if value.is_constant:
            return Value(wide, f"<{', '.join([f'{value.type} {value.text}'] * self.lanes)}>")
        first = self._inserted(undefined(wide), value, 0)
        operands = f"{wide} {first.text}, {wide} undef, {vector_of('i32', self.lanes)} zeroinitializer"
        return self.value(wide, f"shufflevector {operands}")

    def any_lane(self, condition: Value) -> Value:
        """Whether a condition holds for any member."""
        bits = super().convert("bitcast", condition, f"i{self.lanes}")
        return self.icmp_unsigned("!=", bits, Value(bits.type, "0"))

    def lane(self, vector: Value, index: int) -> Value:
        """The value of one member."""
        return self.value(scalar_of(vector.type), f"extractelement {vector.type} {vector.text}, i32 {index}")

    def part(self, vector: Value, lanes: range) -> Value:
        """A vector of some of the lanes."""
        order = ", ".join(f"i32 {lane}" for lane in lanes)
        operands = f"{vector.type} {vector.text}, {vector.type} undef, <{len(lanes)} x i32> <{order}>"
        return self.value(vector_of(scalar_of(vector.type), len(lanes)), f"shufflevector {operands}")

    def gathered(self, values: Sequence[Value]) -> Value:
        """A vector of the values of the members."""
        vector = undefined(vector_of(values[0].type, self.lanes))
        for index, value in enumerate(values):
            vector = self._inserted(vector, value, index)
        return vector

    def _inserted(self, vector: Value, value: Value, index: int) -> Value:
        operands = f"{vector.type} {vector.text}, {value.type} {value.text}, i32 {index}"
        return self.value(vector.type, f"insertelement {operands}")

    def _alike(self, *values: Value) -> list[Value]:
        """The values, all as vectors if one of them is a vector."""
        wide = any(is_vector(value.type) for value in values)
        return [self.widened(value) for value in values] if wide else list(values)

    def _stored(self, type_: Type) -> Type:
        """The type of what an array has for all members: a double for each of them."""
        return vector_of(type_, self.lanes) if type_ == DOUBLE else type_

    def binary(self, operation: str, x: Value, y: Value) -> Value:
        """An operation on two values."""
        return super().binary(operation, *self._alike(x, y))

    def compare(self, predicate: str, x: Value, y: Value) -> Value:
        """Compare two values."""
        return super().compare(predicate, *self._alike(x, y))

    def intrinsic(self, name: str, *arguments: Value) -> Value:
        """A function that LLVM knows."""
        return super().intrinsic(name, *self._alike(*arguments))

    def select(self, condition: Value, x: Value, y: Value) -> Value:
        """Select by a condition, for each member or for all."""
        if is_vector(condition.type):
            return super().select(condition, self.widened(x), self.widened(y))
        return super().select(condition, *self._alike(x, y))

    def convert(self, operation: str, value: Value, type_: Type) -> Value:
        """The value as another type, in each lane if it is a vector."""
        return super().convert(operation, value, with_lanes_of(value.type, type_))

    def load(self, pointer: Value, *, typ: Type) -> Value:
        """Load; a double is loaded for each member."""
        stored = self._stored(typ)
        return self.value(stored, f"load {stored}, ptr {pointer.text}, align {ALIGNMENT}")

    def store(self, value: Value, pointer: Value) -> None:
        """Store; a scalar double is stored for each member."""
        wide = self.widened(value) if value.type == DOUBLE else value
        self._lines.append(f"  store {wide.type} {wide.text}, ptr {pointer.text}, align {ALIGNMENT}")

    def gep(self, pointer: Value, index: Value, type_: Type) -> Value:
        """An address in an array; an element of an array of doubles has one double for each member."""
        return super().gep(pointer, index, self._stored(type_))

    def alloca(self, type_: Type, size: Value | None = None, alignment: int = 0, name: str = "") -> Value:
        """Allocate on the stack; a double is allocated for each member."""
        return super().alloca(self._stored(type_), size, alignment)


class ComponentBuilder(LaneBuilder):
    """A builder for `lanes` consecutive components of the vectors of one member, where another builder is.

    A component of a vector is loaded or stored with those that follow. Scalars are widened once for all blocks of
    components. Nothing that it emits may branch.
    """

    def __init__(self, builder: IRBuilder, lanes: int) -> None:
        super().__init__(builder.block, lanes)
        self._widened: dict[str, Value] = {}

    def widened(self, value: Value) -> Value:
        """As for members."""
        if is_vector(value.type) or value.is_constant:
            return super().widened(value)
        if value.text not in self._widened:
            self._widened[value.text] = super().widened(value)
        return self._widened[value.text]

    def gep(self, pointer: Value, index: Value, type_: Type) -> Value:
        """An address in an array, where each component is one number."""
        return IRBuilder.gep(self, pointer, index, type_)

    def largest(self, vector: Value) -> Value:
        """The largest of the components, none of which is NaN."""
        lanes = self.lanes
        while lanes > 1:
            lanes //= 2
            order = ", ".join(f"i32 {(index + lanes) % self.lanes}" for index in range(self.lanes))
            kind = vector.type
            other = self.value(
                kind, f"shufflevector {kind} {vector.text}, {kind} undef, <{self.lanes} x i32> <{order}>"
            )
            vector = self.select(self.fcmp_ordered(">", vector, other), vector, other)
        return self.lane(vector, 0)


def new_builder(block: BasicBlock, lanes: int) -> IRBuilder:
    """A builder for `lanes` members at once; for 1, that of the module."""
    builder: IRBuilder = LaneBuilder(block, lanes) if lanes > 1 else block.function.module.new_builder(block)
    return builder


def lanes_of(builder: IRBuilder) -> int:
    """The number of members for which a builder emits code."""
    return builder.lanes if isinstance(builder, LaneBuilder) else 1
