"""Instructions of LLVM's intermediate language, each one method, with the names of `llvmlite.ir.IRBuilder`.

After them come the types and idioms that all emitters share.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from mbd_sim.compiler.ir.module import (
    BOOL,
    POINTER,
    VOID,
    BasicBlock,
    Function,
    FunctionType,
    Module,
    Phi,
    Type,
    Value,
    is_vector,
    with_lanes_of,
)

_COMPARISONS = {"==": "eq", "!=": "ne", "<": "lt", "<=": "le", ">": "gt", ">=": "ge", "uno": "no"}
ON_STACK = 64_000  # doubles of an array at most: threads have 8 MB
_LIKELY = {None: None, True: (99, 1), False: (1, 99)}


class IRBuilder:
    """Writes instructions at the end of a block; `unrolled`: see `Module`."""

    def __init__(self, block: BasicBlock) -> None:
        self.position_at_end(block)
        self.unrolled = self.module.unrolled

    def position_at_end(self, block: BasicBlock) -> None:
        """Continue in another block."""
        self.block, self._lines, self._numbers = block, block.lines, block.function.numbers

    @property
    def module(self) -> Module:
        """The module of the function."""
        return self.block.function.module

    def append_basic_block(self, name: str) -> BasicBlock:
        """A new block after all others of the function."""
        return self.block.function.append_basic_block(name)

    def value(self, type_: Type, instruction: str) -> Value:
        """Write an instruction with a result of a type."""
        name = f"%v{next(self._numbers)}"
        self._lines.append(f"  {name} = {instruction}")
        return Value(type_, name)

    def binary(self, operation: str, x: Value, y: Value) -> Value:
        """An operation on two values of the same type, with a result of that type."""
        return self.value(x.type, f"{operation} {x.type} {x.text}, {y.text}")

    def fadd(self, x: Value, y: Value) -> Value:
        """Compute x + y."""
        return self.binary("fadd", x, y)

    def fsub(self, x: Value, y: Value) -> Value:
        """Compute x − y."""
        return self.binary("fsub", x, y)

    def fmul(self, x: Value, y: Value) -> Value:
        """Compute x y."""
        return self.binary("fmul", x, y)

    def fdiv(self, x: Value, y: Value) -> Value:
        """Compute x / y."""
        return self.binary("fdiv", x, y)

    def fneg(self, x: Value) -> Value:
        """Compute −x."""
        return self.value(x.type, f"fneg {x.type} {x.text}")

    def fma(self, x: Value, y: Value, z: Value) -> Value:
        """Compute x y + z, rounded once."""
        if self.module.fast or any(is_vector(value.type) for value in (x, y, z)):
            return self.intrinsic("llvm.fma", x, y, z)
        return self.call(self._fused(), [x, y, z])

    def _fused(self) -> Function:
        """The function x y + z: without optimization, LLVM compiles a call in a third of the time of the operation."""
        if found := self.module.functions.get("fused"):
            return found
        function = Function(self.module, FunctionType(DOUBLE, [DOUBLE] * 3), "fused")
        function.linkage, function.attributes = "internal", ["noinline", "nounwind"]
        builder = IRBuilder(function.append_basic_block("entry"))
        builder.ret(builder.intrinsic("llvm.fma", *function.args))
        return function

    def intrinsic(self, name: str, *arguments: Value) -> Value:
        """A function that LLVM knows, of doubles or of vectors of doubles."""
        type_ = arguments[0].type
        suffix = f"v{type_[1:].partition(' ')[0]}f64" if is_vector(type_) else "f64"
        return self.call(self.module.declared(f"{name}.{suffix}", type_, [type_] * len(arguments)), arguments)

    def add(self, x: Value, y: Value) -> Value:
        """Compute x + y of integers."""
        return self.binary("add", x, y)

    def sub(self, x: Value, y: Value) -> Value:
        """Compute x − y of integers."""
        return self.binary("sub", x, y)

    def mul(self, x: Value, y: Value) -> Value:
        """Compute x y of integers."""
        return self.binary("mul", x, y)

    def urem(self, x: Value, y: Value) -> Value:
        """The remainder of x / y of integers without sign."""
        return self.binary("urem", x, y)

    def and_(self, x: Value, y: Value) -> Value:
        """Combine bits: 1 where both are 1."""
        return self.binary("and", x, y)

    def or_(self, x: Value, y: Value) -> Value:
        """Combine bits: 1 where one of them is 1."""
        return self.binary("or", x, y)

    def xor(self, x: Value, y: Value) -> Value:
        """Combine bits: 1 where they differ."""
        return self.binary("xor", x, y)

    def shl(self, x: Value, y: Value) -> Value:
        """Shift the bits of x to the left."""
        return self.binary("shl", x, y)

    def lshr(self, x: Value, y: Value) -> Value:
        """Shift the bits of x to the right."""
        return self.binary("lshr", x, y)

    def not_(self, condition: Value) -> Value:
        """Whether a condition does not hold."""
        return self.binary("xor", condition, TRUE)

    def compare(self, predicate: str, x: Value, y: Value) -> Value:
        """Compare, with one of LLVM's predicates of `fcmp` or `icmp`."""
        return self.value(with_lanes_of(x.type, BOOL), f"{predicate} {x.type} {x.text}, {y.text}")

    def fcmp_ordered(self, order: str, x: Value, y: Value) -> Value:
        """Compare; false for operands that are not numbers."""
        return self.compare(f"fcmp o{_COMPARISONS[order]}", x, y)

    def fcmp_unordered(self, order: str, x: Value, y: Value) -> Value:
        """Compare; true for operands that are not numbers. The order `uno` is true for no others."""
        return self.compare(f"fcmp u{_COMPARISONS[order]}", x, y)

    def icmp_signed(self, order: str, x: Value, y: Value) -> Value:
        """Compare integers with a sign."""
        return self.compare(f"icmp {'' if order in ('==', '!=') else 's'}{_COMPARISONS[order]}", x, y)

    def icmp_unsigned(self, order: str, x: Value, y: Value) -> Value:
        """Compare integers without a sign."""
        return self.compare(f"icmp {'' if order in ('==', '!=') else 'u'}{_COMPARISONS[order]}", x, y)

    def select(self, condition: Value, x: Value, y: Value) -> Value:
        """The value x if a condition holds, otherwise y."""
        types = f"{condition.type} {condition.text}, {x.type} {x.text}"
        return self.value(x.type, f"select {types}, {y.type} {y.text}")

    def convert(self, operation: str, value: Value, type_: Type) -> Value:
        """The value as another type, by one of LLVM's conversions."""
        return self.value(type_, f"{operation} {value.type} {value.text} to {type_}")

    def bitcast(self, value: Value, type_: Type) -> Value:
        """The bits of a value as another type."""
        return self.convert("bitcast", value, type_)

    def trunc(self, value: Value, type_: Type) -> Value:
        """The low bits of an integer."""
        return self.convert("trunc", value, type_)

    def zext(self, value: Value, type_: Type) -> Value:
        """An integer without sign as a longer one."""
        return self.convert("zext", value, type_)

    def sitofp(self, value: Value, type_: Type) -> Value:
        """An integer as a number."""
        return self.convert("sitofp", value, type_)

    def fptosi(self, value: Value, type_: Type) -> Value:
        """A number without its fraction as an integer."""
        return self.convert("fptosi", value, type_)

    def extract_value(self, pair: Value, index: int, type_: Type) -> Value:
        """A member of a structure, which has a type."""
        return self.value(type_, f"extractvalue {pair.type} {pair.text}, {index}")

    def insert_value(self, pair: Value, value: Value, index: int) -> Value:
        """A structure with another member."""
        return self.value(pair.type, f"insertvalue {pair.type} {pair.text}, {value.type} {value.text}, {index}")

    def alloca(self, type_: Type, size: Value | None = None, alignment: int = 0, name: str = "") -> Value:
        """The address of new memory on the stack for one value or an array; only in the entry block of a function.

        :param alignment: in bytes; 0 for that of the type.
        :param name: for readers of generated C.
        """
        count = f", {size.type} {size.text}" if size else ""
        return self.value(POINTER, f"alloca {type_}{count}" + (f", align {alignment}" if alignment else ""))

    def gep(self, pointer: Value, index: Value, type_: Type) -> Value:
        """The address of an element of an array."""
        return self.value(POINTER, f"getelementptr inbounds {type_}, ptr {pointer.text}, {index.type} {index.text}")

    def load(self, pointer: Value, *, typ: Type) -> Value:
        """The value of a type at an address."""
        return self.value(typ, f"load {typ}, ptr {pointer.text}")

    def store(self, value: Value, pointer: Value) -> None:
        """Set the value at an address."""
        self._lines.append(f"  store {value.type} {value.text}, ptr {pointer.text}")

    def call(self, function: Function, arguments: Sequence[Value], *, inline: bool = True) -> Value:
        """Call a function, which is not inlined here if `inline` is false."""
        result = function.function_type.result
        call = f'call {result} @"{function.name}"({", ".join([f"{a.type} {a.text}" for a in arguments])})'
        call += "" if inline else " noinline"
        return self._called(result, call)

    def call_address(self, address: Value, result: Type, arguments: Sequence[Value]) -> Value:
        """Call machine code at an address."""
        given = ", ".join([f"{a.type} {a.text}" for a in arguments])
        return self._called(result, f"call {result} {address.text}({given})")

    def unreachable(self) -> None:
        """Nothing leads to this block."""
        self._terminate("unreachable")

    def _called(self, result: Type, call: str) -> Value:
        if result != VOID:
            return self.value(result, call)
        self._lines.append(f"  {call}")
        return Value(VOID, "")

    def phi(self, type_: Type) -> Phi:
        """A value that depends on where its block is reached from; only at the start of a block."""
        value = Phi(type_, f"%v{next(self._numbers)}")
        self._lines.append(value)
        return value

    def branch(self, target: BasicBlock) -> None:
        """Continue with a block."""
        self._terminate(f"br label %{target.name}")

    def cbranch(
        self, condition: Value, then: BasicBlock, otherwise: BasicBlock, weights: tuple[int, int] | None = None
    ) -> None:
        """Continue with one of two blocks; `weights` say how often with each."""
        counts = "" if weights is None else f', !prof !{{!"branch_weights", i32 {weights[0]}, i32 {weights[1]}}}'
        self._terminate(f"br i1 {condition.text}, label %{then.name}, label %{otherwise.name}{counts}")

    def ret(self, value: Value) -> None:
        """Return a value."""
        self._free()
        self._terminate(f"ret {value.type} {value.text}")

    def ret_void(self) -> None:
        """Return nothing."""
        self._free()
        self._terminate("ret void")

    def allocate(self, size: int) -> Value:
        """The address of new doubles that are freed where the function returns; only in its entry block."""
        self.block.function.allocated.append(self.allocated(integer(size)))
        return self.block.function.allocated[-1]

    def allocated(self, size: Value) -> Value:
        """The address of new memory for so many doubles or integers, until it is freed."""
        return self.call(self.module.declared("malloc", POINTER, [INT]), [self.mul(size, integer(8))])

    def free(self, array: Value) -> None:
        """Free memory."""
        self.call(self.module.declared("free", VOID, [POINTER]), [array])

    def _free(self) -> None:
        for array in self.block.function.allocated:
            self.free(array)

    def _terminate(self, instruction: str) -> None:
        self._lines.append(f"  {instruction}")
        self.block.is_terminated = True

    def named(self, value: Value, name: str) -> Value:
        """The value, with a name for readers of generated C."""
        return value

    def comment(self, text: str) -> None:
        """What follows, for readers of generated C."""

    def constants(self, values: Sequence[float], allocate: Callable[[], Value], name: str) -> Value:
        """The address of constant numbers, in an array that is allocated; only in the entry block of a function."""
        array = allocate()
        for index, value in enumerate(values):
            self.store(number(value), element(self, array, index))
        return array

    def by_address(self, value: Value, memory: Value) -> Value:
        """A number as functions of instruction lists take it: the address of memory that holds it."""
        self.store(value, memory)
        return memory

    def loop(self, first: Value, beyond: Value, body: Callable[[Value], object]) -> None:
        """Emit `body` for every index from `first` to before `beyond`."""
        before = self.block
        head, inside, after = (self.append_basic_block(name) for name in ("head", "inside", "after"))
        self.branch(head)
        self.position_at_end(head)
        index = self.phi(first.type)
        index.add_incoming(first, before)
        self.cbranch(self.icmp_signed("<", index, beyond), inside, after)
        self.position_at_end(inside)
        body(index)
        following = self.add(index, Value(first.type, "1"))
        index.add_incoming(following, self.block)
        self.branch(head)
        self.position_at_end(after)

    def repeat(self, first: Value, body: Callable[[Value], Value]) -> None:
        """Emit `body`, which takes a number that grows from `first` on, until the condition that it returns fails."""
        before, again, done = self.block, self.append_basic_block("again"), self.append_basic_block("done")
        self.branch(again)
        self.position_at_end(again)
        count = self.phi(first.type)
        count.add_incoming(first, before)
        more = body(count)
        count.add_incoming(self.add(count, Value(first.type, "1")), self.block)
        self.cbranch(more, again, done)
        self.position_at_end(done)

    @contextmanager
    def if_then(self, condition: Value, likely: bool | None = None) -> Iterator[None]:
        """What is emitted within is executed if a condition holds."""
        inside, after = self.append_basic_block("then"), self.append_basic_block("after")
        self.cbranch(condition, inside, after, _LIKELY[likely])
        with self._within(inside, after):
            yield
        self.position_at_end(after)

    @contextmanager
    def if_else(
        self, condition: Value, likely: bool | None = None
    ) -> Iterator[tuple[AbstractContextManager[None], AbstractContextManager[None]]]:
        """Two contexts: what is emitted within the first is executed if a condition holds, otherwise the second."""
        inside, otherwise, after = (self.append_basic_block(name) for name in ("then", "otherwise", "after"))
        self.cbranch(condition, inside, otherwise, _LIKELY[likely])
        yield self._within(inside, after), self._within(otherwise, after)
        self.position_at_end(after)

    @contextmanager
    def _within(self, block: BasicBlock, after: BasicBlock) -> Iterator[None]:
        self.position_at_end(block)
        yield
        if not self.block.is_terminated:
            self.branch(after)


DOUBLE, INT = "double", "i64"
FALSE, TRUE, NULL = Value(BOOL, "false"), Value(BOOL, "true"), Value(POINTER, "null")

VECTOR = 32  # bytes, of four doubles


def number(value: float) -> Value:
    """A double."""
    return Value(DOUBLE, f"0x{struct.pack('>d', value).hex()}")


def integer(value: int) -> Value:
    """A 64-bit integer."""
    return Value(INT, str(value))


def element(builder: IRBuilder, array: Value, index: int | Value) -> Value:
    """The address of one double of an array."""
    return builder.gep(array, integer(index) if isinstance(index, int) else index, DOUBLE)


def local_array(
    builder: IRBuilder, size: int, *, in_registers: bool = False, aligned: bool = False, name: str = ""
) -> Value:
    """An array of doubles for one call, on the stack if it is small; only in the entry block of a function.

    LLVM keeps one `in_registers`, as far as they suffice, if all of its accesses have constant indices. Vectors of four
    in an `aligned` one lie in a line of the cache each.
    """
    if in_registers:
        return builder.alloca(f"[{max(size, 1)} x {DOUBLE}]")
    if size > ON_STACK:
        return builder.allocate(size)
    return builder.alloca(DOUBLE, integer(max(size, 1)), alignment=VECTOR if aligned else 0, name=name)
