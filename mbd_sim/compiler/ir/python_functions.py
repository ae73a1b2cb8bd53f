"""Functions in a subset of Python as IR: numbers, arrays, records, conditions, loops, and calls of each other.

The same text also runs as Python, with the same results to the last bit: each operation becomes one instruction.

- Parameters and results are annotated with `float`, `int`, `bool`, `Array`, `Integers`, or a record: a dataclass of
  such fields, of which each takes 8 bytes (`packed`).
- Variables keep their kind. `a[i]` is an element, and `a[i:]` the array from there on.
- `zeros(n)` and `integers(n)` are new arrays of the function, which end with it, and therefore not within loops.
- An `External` calls machine code whose address is its first argument.
- Numbers that are divided with `//` or `%` are not negative.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from mbd_sim.compiler.ir.builder import DOUBLE, INT, NULL, IRBuilder, integer, number
from mbd_sim.compiler.ir.module import BOOL, POINTER, BasicBlock, Function, FunctionType, Module, Type, Value
from mbd_sim.compiler.ir.python_kinds import ELEMENTS, TYPES, External, integers, name_of, signature_of, zeros

ON_STACK = 8_000  # numbers of an array at most, of several in each of a dozen functions that call each other


@dataclass(frozen=True)
class _Typed:
    kind: str
    value: Value


def emit_function(module: Module, function: Callable[..., Any], *, exported: bool = False) -> Function:
    """Emit a function, unless it is there, and those that it calls.

    :raises NotImplementedError: it does not keep to the subset; the message names the line.
    """
    emitted = module.functions.get(name_of(function)) or _Translation(module, function).run()
    if exported:
        emitted.linkage = ""
    return emitted


@functools.cache
def _definitions(module: str) -> Mapping[str, ast.FunctionDef]:
    """The functions in the text of a module."""
    parsed = ast.parse(inspect.getsource(sys.modules[module]))
    return {each.name: each for each in parsed.body if isinstance(each, ast.FunctionDef)}


def _returned(kind: str) -> Type:
    """The type of a result; one bit would leave the others of a register open."""
    return INT if kind == "bool" else TYPES.get(kind, POINTER)


class _Translation:
    """The translation of one function."""

    def __init__(self, module: Module, function: Callable[..., Any]) -> None:
        self._module, self._python = module, function
        self._result, kinds = signature_of(function)
        self._globals = function.__globals__
        types = [TYPES.get(kind, POINTER) for kind in kinds]
        self.function = Function(module, FunctionType(_returned(self._result), types), name_of(function))
        self.function.linkage = "internal"
        self.function.attributes = ["noinline", "nounwind"]
        self._entry = IRBuilder(self.function.append_basic_block("entry"))
        self._b = IRBuilder(self.function.append_basic_block("body"))
        self._first = self._b.block
        self._loops: list[tuple[BasicBlock, BasicBlock]] = []  # where `continue` and `break` lead
        self._allocated: list[Value] = []  # the addresses of addresses of arrays that are not on the stack, or of null
        self._names: dict[str, tuple[str, Value]] = {}
        self._records: dict[str, Any] = {}  # those of fields of other records, by their kind
        parsed = _definitions(function.__module__)[function.__name__]
        self._parsed, self._line = parsed, parsed.lineno
        for parameter, kind, value in zip(parsed.args.args, kinds, self.function.args, strict=True):
            self._set(parameter.arg, _Typed(kind, value))

    def run(self) -> Function:
        """Translate it."""
        self._statements(self._parsed.body)
        if not self._b.block.is_terminated:
            if self._result != "None":
                raise self._unknown("a path without a result")
            self._free()
            self._b.ret_void()
        self._entry.branch(self._first)
        return self.function

    def _unknown(self, what: str) -> NotImplementedError:
        where = f"line {self._line} of {self._python.__module__}"
        return NotImplementedError(f"{where}: {what} cannot be compiled")

    # Statements

    def _statements(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            if self._b.block.is_terminated:
                return
            self._line = statement.lineno
            handler = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if handler is None:
                raise self._unknown(ast.unparse(statement))
            handler(statement)

    def _pass(self, _: ast.Pass) -> None:
        """Nothing."""

    def _expr(self, statement: ast.Expr) -> None:
        if not isinstance(statement.value, ast.Constant):  # a docstring is one
            self._value(statement.value)

    def _assign(self, statement: ast.Assign) -> None:
        (target,) = statement.targets
        if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
            values = [self._value(each) for each in statement.value.elts]
            for each, value in zip(target.elts, values, strict=True):
                self._store(each, value)
        else:
            self._store(target, self._value(statement.value))

    def _augassign(self, statement: ast.AugAssign) -> None:
        value = self._binary(type(statement.op).__name__, self._value(statement.target), self._value(statement.value))
        self._store(statement.target, value)

    def _store(self, target: ast.expr, value: _Typed) -> None:
        if isinstance(target, ast.Name):
            self._set(target.id, value)
        elif isinstance(target, ast.Subscript):
            kind, address = self._element(target)
            self._b.store(self._as(kind, value), address)
        else:
            raise self._unknown(ast.unparse(target))

    def _set(self, name: str, value: _Typed) -> None:
        if name not in self._names:
            self._names[name] = value.kind, self._entry.alloca(TYPES.get(value.kind, POINTER))
        kind, address = self._names[name]
        self._b.store(self._as(kind, value), address)

    def _return(self, statement: ast.Return) -> None:
        if statement.value is None:
            self._free()
            self._b.ret_void()
            return
        value = self._as(self._result, self._value(statement.value))
        self._free()
        self._b.ret(self._b.zext(value, INT) if self._result == "bool" else value)

    def _if(self, statement: ast.If) -> None:
        then, otherwise, after = self._blocks("then", "otherwise", "after")
        self._b.cbranch(self._truth(statement.test), then, otherwise)
        for block, body in ((then, statement.body), (otherwise, statement.orelse)):
            self._b.position_at_end(block)
            self._statements(body)
            self._go(after)
        self._b.position_at_end(after)
        if not self._is_reached(after):
            self._b.unreachable()

    def _while(self, statement: ast.While) -> None:
        head, inside, after = self._blocks("head", "inside", "after")
        self._go(head)
        self._b.position_at_end(head)
        self._b.cbranch(self._truth(statement.test), inside, after)
        with self._loop(head, after):
            self._b.position_at_end(inside)
            self._statements(statement.body)
            self._go(head)
        self._b.position_at_end(after)

    def _for(self, statement: ast.For) -> None:
        bounds, target = statement.iter, statement.target
        if not (isinstance(bounds, ast.Call) and ast.unparse(bounds.func) == "range" and isinstance(target, ast.Name)):
            raise self._unknown(ast.unparse(bounds))
        given = [self._value(each).value for each in bounds.args]
        start, end = (integer(0), given[0]) if len(given) == 1 else (given[0], given[1])
        step = given[2] if len(given) > 2 else integer(1)
        head, inside, following, after = self._blocks("head", "inside", "following", "after")
        index = self._entry.alloca(INT)
        self._b.store(start, index)
        self._go(head)
        self._b.position_at_end(head)
        present = self._b.load(index, typ=INT)
        order = ">" if step.text.startswith("-") else "<"
        self._b.cbranch(self._b.icmp_signed(order, present, end), inside, after)
        with self._loop(following, after):
            self._b.position_at_end(inside)
            self._set(target.id, _Typed("int", present))
            self._statements(statement.body)
            self._go(following)
        self._b.position_at_end(following)
        self._b.store(self._b.add(self._b.load(index, typ=INT), step), index)
        self._go(head)
        self._b.position_at_end(after)

    def _continue(self, _: ast.Continue) -> None:
        self._b.branch(self._loops[-1][0])

    def _break(self, _: ast.Break) -> None:
        self._b.branch(self._loops[-1][1])

    @contextmanager
    def _loop(self, following: BasicBlock, after: BasicBlock) -> Iterator[None]:
        self._loops.append((following, after))
        yield
        self._loops.pop()

    def _blocks(self, *names: str) -> list[BasicBlock]:
        return [self._b.append_basic_block(name) for name in names]

    def _go(self, target: BasicBlock) -> None:
        if not self._b.block.is_terminated:
            self._b.branch(target)

    def _is_reached(self, block: BasicBlock) -> bool:
        lines = [str(own.lines[-1]) for own in self.function.blocks if own.is_terminated]
        return any(f"%{block.name}" in line.replace(",", " ").split() for line in lines)

    # Expressions

    def _value(self, expression: ast.expr) -> _Typed:
        handler = getattr(self, f"_value_of_{type(expression).__name__.lower()}", None)
        if handler is None:
            raise self._unknown(ast.unparse(expression))
        found: _Typed = handler(expression)
        return found

    def _value_of_constant(self, expression: ast.Constant) -> _Typed:
        return self._constant(expression.value)

    def _constant(self, value: object) -> _Typed:
        if isinstance(value, bool):
            return _Typed("bool", Value(BOOL, str(value).lower()))
        if isinstance(value, int):
            return _Typed("int", integer(value))
        if isinstance(value, float):
            return _Typed("float", number(value))
        raise self._unknown(repr(value))

    def _value_of_name(self, expression: ast.Name) -> _Typed:
        if expression.id not in self._names:
            return self._constant(self._globals.get(expression.id))
        kind, address = self._names[expression.id]
        return _Typed(kind, self._b.load(address, typ=TYPES.get(kind, POINTER)))

    def _value_of_attribute(self, expression: ast.Attribute) -> _Typed:
        if ast.unparse(expression) == "math.inf":
            return self._constant(math.inf)
        record = self._value(expression.value)
        known = self._globals.get(record.kind) or self._records[record.kind]
        names = {field.name: (slot, field.type) for slot, field in enumerate(fields(known))}
        slot, kind = names[expression.attr]
        assert isinstance(kind, str)
        self._records.setdefault(kind, vars(sys.modules[known.__module__]).get(kind))
        address = self._b.gep(record.value, integer(slot), INT)
        if kind == "bool":
            return _Typed(kind, self._b.trunc(self._b.load(address, typ=INT), BOOL))
        return _Typed(kind, self._b.load(address, typ=TYPES.get(kind, POINTER)))

    def _value_of_subscript(self, expression: ast.Subscript) -> _Typed:
        if isinstance(expression.slice, ast.Slice):
            array = self._value(expression.value)
            assert expression.slice.lower is not None
            first = self._value(expression.slice.lower).value
            return _Typed(array.kind, self._b.gep(array.value, first, TYPES[ELEMENTS[array.kind]]))
        kind, address = self._element(expression)
        return _Typed(kind, self._b.load(address, typ=TYPES[kind]))

    def _element(self, expression: ast.Subscript) -> tuple[str, Value]:
        array, index = self._value(expression.value), self._value(expression.slice)
        kind = ELEMENTS[array.kind]
        return kind, self._b.gep(array.value, index.value, TYPES[kind])

    def _value_of_binop(self, expression: ast.BinOp) -> _Typed:
        return self._binary(type(expression.op).__name__, self._value(expression.left), self._value(expression.right))

    def _binary(self, operation: str, left: _Typed, right: _Typed) -> _Typed:
        kind = "float" if "float" in (left.kind, right.kind) or operation == "Div" else "int"
        names = {"Add": "add", "Sub": "sub", "Mult": "mul", "Div": "div", "FloorDiv": "div", "Mod": "rem"}
        if operation not in names or (operation == "FloorDiv" and kind == "float"):
            raise self._unknown(operation)
        prefix = "f" if kind == "float" else "u" if operation in ("FloorDiv", "Mod") else ""
        x, y = self._as(kind, left), self._as(kind, right)
        return _Typed(kind, self._b.binary(f"{prefix}{names[operation]}", x, y))

    def _value_of_unaryop(self, expression: ast.UnaryOp) -> _Typed:
        if isinstance(expression.op, ast.Not):
            return _Typed("bool", self._b.not_(self._truth(expression.operand)))
        if not isinstance(expression.op, ast.USub):
            raise self._unknown(ast.unparse(expression))
        value = self._value(expression.operand)
        if value.value.is_constant and value.kind == "int":
            return _Typed("int", integer(-int(value.value.text)))
        negative = self._b.fneg(value.value) if value.kind == "float" else self._b.sub(integer(0), value.value)
        return _Typed(value.kind, negative)

    def _value_of_compare(self, expression: ast.Compare) -> _Typed:
        if isinstance(expression.ops[0], ast.In) and isinstance(expression.comparators[0], ast.Tuple):
            equal = [ast.Compare(expression.left, [ast.Eq()], [each]) for each in expression.comparators[0].elts]
            return self._value_of_boolop(ast.BoolOp(ast.Or(), list(equal)))
        orders = {"Eq": "==", "NotEq": "!=", "Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">="}
        values, found = [self._value(each) for each in (expression.left, *expression.comparators)], list[Value]()
        for operation, left, right in zip(expression.ops, values[:-1], values[1:], strict=True):
            order, kind = orders[type(operation).__name__], "float" if "float" in (left.kind, right.kind) else left.kind
            x, y = self._as(kind, left), self._as(kind, right)
            if kind != "float":
                found.append(self._b.icmp_signed(order, x, y))
            elif order == "!=":
                found.append(self._b.fcmp_unordered(order, x, y))
            else:
                found.append(self._b.fcmp_ordered(order, x, y))
        result = found[0]
        for each in found[1:]:
            result = self._b.and_(result, each)
        return _Typed("bool", result)

    def _value_of_boolop(self, expression: ast.BoolOp) -> _Typed:
        memory, (after,) = self._entry.alloca(BOOL), self._blocks("after")
        is_and = isinstance(expression.op, ast.And)
        for position, each in enumerate(expression.values):
            condition = self._truth(each)
            self._b.store(condition, memory)
            if position == len(expression.values) - 1:
                self._go(after)
                continue
            (following,) = self._blocks("following")
            self._b.cbranch(condition, *((following, after) if is_and else (after, following)))
            self._b.position_at_end(following)
        self._b.position_at_end(after)
        return _Typed("bool", self._b.load(memory, typ=BOOL))

    def _value_of_ifexp(self, expression: ast.IfExp) -> _Typed:
        then, otherwise, after = self._blocks("then", "otherwise", "after")
        self._b.cbranch(self._truth(expression.test), then, otherwise)
        memory, kind = None, ""
        for block, each in ((then, expression.body), (otherwise, expression.orelse)):
            self._b.position_at_end(block)
            value = self._value(each)
            if memory is None:
                kind = value.kind
                memory = self._entry.alloca(TYPES.get(kind, POINTER))
            self._b.store(self._as(kind, value), memory)
            self._go(after)
        assert memory is not None
        self._b.position_at_end(after)
        return _Typed(kind, self._b.load(memory, typ=TYPES.get(kind, POINTER)))

    def _truth(self, expression: ast.expr) -> Value:
        value = self._value(expression)
        if value.kind == "bool":
            return value.value
        if value.kind == "int":
            return self._b.icmp_signed("!=", value.value, integer(0))
        if value.kind == "float":
            return self._b.fcmp_unordered("!=", value.value, number(0.0))
        raise self._unknown(ast.unparse(expression))

    def _as(self, kind: str, value: _Typed) -> Value:
        """The value as one of a kind: integers are numbers as well."""
        if kind == value.kind:
            return value.value
        if kind == "int" and value.kind == "bool":
            return self._b.zext(value.value, INT)
        if kind == "float" and value.kind == "int":
            if value.value.is_constant:
                return number(float(value.value.text))
            return self._b.sitofp(value.value, DOUBLE)
        raise self._unknown(f"{value.kind} as {kind}")

    # Calls

    def _value_of_call(self, expression: ast.Call) -> _Typed:
        name = ast.unparse(expression.func)
        if name == "any" and isinstance(expression.args[0], ast.GeneratorExp):
            return self._any(expression.args[0])
        if name == "cast":  # of an array of slots to a record
            return _Typed(ast.unparse(expression.args[0]).strip("'\""), self._value(expression.args[1]).value)
        arguments = [self._value(each) for each in expression.args]
        if name in ("abs", "math.sqrt"):
            intrinsic = "llvm.fabs" if name == "abs" else "llvm.sqrt"
            return _Typed("float", self._b.intrinsic(intrinsic, self._as("float", arguments[0])))
        if name == "int":
            return _Typed("int", self._b.convert("fptosi", self._as("float", arguments[0]), INT))
        if name == "math.atan2":
            function = self._module.declared("atan2", DOUBLE, [DOUBLE, DOUBLE])
            return _Typed("float", self._b.call(function, [self._as("float", each) for each in arguments]))
        if name == "math.isfinite":
            difference = self._b.fsub(arguments[0].value, arguments[0].value)
            return _Typed("bool", self._b.fcmp_ordered("==", difference, number(0.0)))
        if name in ("max", "min"):
            return self._extreme(">" if name == "max" else "<", *arguments)
        called = self._globals.get(name)
        if called is zeros or called is integers:
            return self._new_array("Array" if called is zeros else "Integers", arguments[0].value)
        if isinstance(called, External):
            values = [self._as(kind, one) for kind, one in zip(called.arguments, arguments[1:], strict=True)]
            return self._called(called, arguments[0].value, values)
        if is_dataclass(called):
            return self._new_record(called, arguments)
        if not callable(called):
            raise self._unknown(name)
        result, kinds = signature_of(called)
        values = [self._as(kind, one) for kind, one in zip(kinds, arguments, strict=True)]
        returned = self._b.call(emit_function(self._module, called), values)
        return _Typed(result, self._b.trunc(returned, BOOL) if result == "bool" else returned)

    def _any(self, expression: ast.GeneratorExp) -> _Typed:
        """Whether a condition holds for an index in a range: the generator as a loop."""
        (generator,), found = expression.generators, self._entry.alloca(BOOL)
        self._b.store(Value(BOOL, "false"), found)
        self._names["any"] = "bool", found
        holds = ast.Assign([ast.Name("any")], ast.Constant(True), lineno=self._line)
        test = ast.If(expression.elt, [holds, ast.Break(lineno=self._line)], [], lineno=self._line)
        self._for(ast.For(generator.target, generator.iter, [test], [], lineno=self._line))
        return _Typed("bool", self._b.load(found, typ=BOOL))

    def _extreme(self, order: str, first: _Typed, second: _Typed) -> _Typed:
        """The second argument if it is beyond the first one, as in Python."""
        kind = "float" if "float" in (first.kind, second.kind) else "int"
        x, y = self._as(kind, first), self._as(kind, second)
        beyond = self._b.fcmp_ordered(order, y, x) if kind == "float" else self._b.icmp_signed(order, y, x)
        return _Typed(kind, self._b.select(beyond, y, x))

    def _new_array(self, kind: str, size: Value) -> _Typed:
        if self._loops:
            raise self._unknown("a new array within a loop")
        element, memory, kept = TYPES[ELEMENTS[kind]], self._entry.alloca(POINTER), self._entry.alloca(POINTER)
        self._entry.store(NULL, kept)
        self._allocated.append(kept)
        with self._b.if_else(self._b.icmp_signed(">", size, integer(ON_STACK)), likely=False) as (is_large, is_small):
            with is_large:
                self._b.store(self._b.allocated(size), kept)
                self._b.store(self._b.load(kept, typ=POINTER), memory)
            with is_small:
                self._b.store(self._b.alloca(element, size), memory)
        array, zero = self._b.load(memory, typ=POINTER), number(0.0) if element == DOUBLE else integer(0)
        self._b.loop(integer(0), size, lambda index: self._b.store(zero, self._b.gep(array, index, element)))
        return _Typed(kind, array)

    def _free(self) -> None:
        """Free what is not on the stack of the function."""
        for kept in self._allocated:
            array = self._b.load(kept, typ=POINTER)
            with self._b.if_then(self._b.icmp_unsigned("!=", array, NULL), likely=False):
                self._b.free(array)

    def _new_record(self, record: Any, values: Sequence[_Typed]) -> _Typed:
        own = fields(record)
        memory = self._entry.alloca(INT, integer(len(own)))
        for slot, (field, value) in enumerate(zip(own, values, strict=True)):
            kind = "int" if field.type == "bool" else str(field.type)
            self._b.store(self._as(kind, value), self._b.gep(memory, integer(slot), INT))
        return _Typed(record.__name__, memory)

    def _called(self, external: External, address: Value, arguments: Sequence[Value]) -> _Typed:
        code = self._b.convert("inttoptr", address, POINTER)
        return _Typed(external.result, self._b.call_address(code, TYPES[external.result], arguments))
