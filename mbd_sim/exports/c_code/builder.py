"""The emitters of steps as C: a builder with the interface of `IRBuilder` whose functions are C99 text, and the steps.

So a method is described once, and the exported code has the operations of the kernel in the same order, and its bits.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, integer
from mbd_sim.compiler.ir.module import BOOL, POINTER, VOID, BasicBlock, Function, FunctionType, Module, Type, Value
from mbd_sim.compiler.kernel import StepNeeds, step_of
from mbd_sim.compiler.lists.instruction_list import Instructions
from mbd_sim.compiler.lists.lowering import instruction_count
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.steps.emitter import ChangesBetweenSteps, StepEmitter, System
from mbd_sim.exports.c_code.functions import c_function, literal
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.exports.c_code.statements import (
    BITS,
    BOTH,
    CHOICE,
    COMPARISON,
    EITHER,
    NAME,
    PRODUCT,
    SIGN,
    SUM,
    TYPES,
    FunctionText,
    Local,
    Statement,
    statements_in,
)
from mbd_sim.integrators.method import Method

_BINARY = {
    "fadd": ("{0} + {1}", SUM), "fsub": ("{0} - {1}", SUM), "fmul": ("{0} * {1}", PRODUCT),
    "fdiv": ("{0} / {1}", PRODUCT), "add": ("{0} + {1}", SUM), "sub": ("{0} - {1}", SUM), "mul": ("{0} * {1}", PRODUCT),
    "urem": ("{0} % {1}", PRODUCT), "shl": ("{0} << {1}", BITS), "lshr": ("{0} >> {1}", BITS),
}  # fmt: skip
_LOGICAL = {"and": ("{0} && {1}", BOTH), "or": ("{0} || {1}", EITHER)}
_BITWISE = {"and": ("{0} & {1}", BITS), "or": ("{0} | {1}", BITS)}
_ORDERS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_INTEGERS = {"add": operator.add, "sub": operator.sub, "mul": operator.mul}
_CASTS = {"sitofp": "double", "fptosi": "int64_t", "zext": "int64_t"}


class CModule(Module):
    """The functions of a C file; `texts` are the finished ones in order, each after those that it calls.

    `size` is that of the state, which the text calls SIZE. Operations on vectors are loops. `unchanged` are the
    positions of arguments through which a function changes nothing.
    """

    def __init__(self, size: int) -> None:
        super().__init__("", CBuilder, is_fast=False)
        self.size, self.texts = size, list[str]()
        self.unchanged: dict[str, frozenset[int]] = {}


class CBuilder(IRBuilder):
    """Writes statements of a C function. Integers are never negative, so that their sign does not count."""

    module: CModule

    def __init__(self, block: BasicBlock) -> None:
        super().__init__(block)
        self._statements: list[Statement] = []
        self._open = self._statements
        self._locals: dict[str, Local] = {}
        self._places: dict[str, tuple[Value, Value]] = {}  # arrays and indices of addresses
        self._results: set[str] = set()
        self._hints: dict[str, str] = {}  # names of values
        self._depth = 0
        self._tables: list[str] = []

    def named(self, value: Value, name: str) -> Value:
        """A value that has a name in the text, unless it has one already."""
        if value.text in self._results:
            self._hints[value.text] = name
        return value

    def comment(self, text: str) -> None:
        """Explain what follows."""
        self._open.append(Statement(f"/* {text} */", ()))

    def by_address(self, value: Value, memory: Value) -> Value:
        """The number itself: C functions take numbers by value."""
        return value

    def constants(self, values: Sequence[float], allocate: Callable[[], Value], name: str) -> Value:
        """The address of constant numbers."""
        listed = ", ".join(map(literal, values))
        self._tables.append(f"    static const double {name}[{self._count(len(values))}] = {{{listed}}};")
        return Value("const double *", f"%{name}")

    def alloca(self, type_: Type, size: Value | None = None, alignment: int = 0, name: str = "") -> Value:
        """A variable, or an array of more than one number."""
        count = 1 if size is None else int(size.text)
        chosen = name = name or "a"
        while f"%{chosen}" in self._locals or f"%{chosen}" in {argument.text for argument in self.block.function.args}:
            chosen = f"{name}{next(self._numbers)}"
        self._locals[f"%{chosen}"] = Local(TYPES[type_], None if count == 1 else count)
        return Value(POINTER, f"%{chosen}")

    def _value(
        self, type_: Type, template: str, operands: Sequence[Value], level: int, *, reads: bool = False
    ) -> Value:
        result = Value(type_, f"%v{next(self._numbers)}")
        self._results.add(result.text)
        self._open.append(Statement(template, operands, result, level, reads))
        return result

    def binary(self, operation: str, x: Value, y: Value) -> Value:
        """An operation on two values."""
        if x.type == BOOL:
            return self._logical(operation, x, y)
        if operation in _INTEGERS and y.is_constant:
            if x.is_constant:
                return integer(_INTEGERS[operation](int(x.text), int(y.text)))
            if y.text == ("1" if operation == "mul" else "0"):
                return x
        return self._value(x.type, *_with_operands({**_BITWISE, **_BINARY}[operation], x, y))

    def _logical(self, operation: str, x: Value, y: Value) -> Value:
        """An operation on conditions; those that are known are left out."""
        if operation == "xor":
            if x.is_constant:
                return Value(BOOL, "false" if x.text == "true" else "true")
            return self._value(BOOL, "!{0}", (x,), SIGN)
        dominant = "false" if operation == "and" else "true"
        if x.is_constant or y.is_constant:
            known, other = (x, y) if x.is_constant else (y, x)
            return known if known.text == dominant else other
        return self._value(BOOL, *_with_operands(_LOGICAL[operation], x, y))

    def fneg(self, x: Value) -> Value:
        """Compute −x."""
        return self._value(x.type, "-{0}", (x,), SIGN)

    def fma(self, x: Value, y: Value, z: Value) -> Value:
        """Compute x y + z, rounded once."""
        return self.intrinsic("llvm.fma", x, y, z)

    def intrinsic(self, name: str, *arguments: Value) -> Value:
        """A function of the library of mathematics."""
        return self._value(DOUBLE, _call(name.removeprefix("llvm."), len(arguments)), arguments, NAME)

    def compare(self, predicate: str, x: Value, y: Value) -> Value:
        """Compare, where possible now."""
        kind, order = predicate.split(" ")
        sign = _ORDERS.get(order[-2:], "uno")
        if kind == "icmp" and x.is_constant and y.is_constant and sign in ("==", "!="):
            return Value(BOOL, "true" if (x.text == y.text) == (sign == "==") else "false")
        if kind == "fcmp" and order == "one":
            return self._value(BOOL, "islessgreater({0}, {1})", (x, y), NAME)
        if kind == "fcmp" and order == "ueq":
            return self._value(BOOL, "!islessgreater({0}, {1})", (x, y), SIGN)
        if sign == "uno":
            return self._value(BOOL, "isnan({0})", (x,), NAME) if x is y else self._unordered(x, y)
        if kind == "fcmp" and order.startswith("u") and sign in _OPPOSITE:
            return self._value(BOOL, f"!({{0}} {_OPPOSITE[sign]} {{1}})", (x, y), SIGN)
        return self._value(BOOL, f"{{0}} {sign} {{1}}", (x, y), COMPARISON)

    def _unordered(self, x: Value, y: Value) -> Value:
        return self._value(BOOL, "isunordered({0}, {1})", (x, y), NAME)

    def select(self, condition: Value, x: Value, y: Value) -> Value:
        """The value x if a condition holds, otherwise y."""
        if condition.is_constant:
            return x if condition.text == "true" else y
        return self._value(x.type, "{0} ? {1} : {2}", (condition, x, y), CHOICE)

    def convert(self, operation: str, value: Value, type_: Type) -> Value:
        """A number as another type."""
        return self._value(type_, f"({_CASTS[operation]}){{0}}", (value,), SIGN)

    def gep(self, pointer: Value, index: Value, type_: Type) -> Value:
        """The address of an element of an array."""
        if index.text == "0":
            return pointer
        address = self._value(pointer.type, "{0} + {1}", (pointer, index), SUM)
        self._places[address.text] = pointer, index
        return address

    def _place(self, pointer: Value) -> tuple[str, tuple[Value, ...]]:
        """How a number in memory is written, and of what."""
        if pointer.text in self._places and pointer.text not in self._hints:
            return "{0}[{1}]", self._places[pointer.text]
        local = self._locals.get(pointer.text)
        return "{0}" if local is not None and local.size is None else "{0}[0]", (pointer,)

    def _array(self, pointer: Value) -> Value:
        """The array in which an address is."""
        while pointer.text in self._places:
            pointer = self._places[pointer.text][0]
        return pointer

    def load(self, pointer: Value, *, typ: Type) -> Value:
        """The number at an address."""
        template, operands = self._place(pointer)
        return self._value(typ, template, operands, NAME, reads=True)

    def store(self, value: Value, pointer: Value) -> None:
        """Set the number at an address."""
        template, operands = self._place(pointer)
        statement = Statement(f"{template} = {{{len(operands)}}};", (*operands, value), writes=True)
        statement.target, statement.changed = operands[0], [self._array(operands[0])]
        self._open.append(statement)

    def call(self, function: Function, arguments: Sequence[Value], *, inline: bool = True) -> Value:
        """Call a function. Those with a result change nothing."""
        result, text = function.function_type.result, _call(function.name, len(arguments))
        if result != VOID:
            return self._value(result, text, arguments, NAME)
        passed = [f"&{{{index}}}" if self._is_variable(one) else f"{{{index}}}" for index, one in enumerate(arguments)]
        statement = Statement(f"{function.name}({', '.join(passed)});", arguments, writes=True)
        unchanged = self.module.unchanged.get(function.name, frozenset())
        statement.changed = [self._array(one) for index, one in enumerate(arguments) if index not in unchanged]
        self._open.append(statement)
        return Value(VOID, "")

    def _is_variable(self, value: Value) -> bool:
        return value.text in self._locals and self._locals[value.text].size is None

    def ret_void(self) -> None:
        """End the function, whose text is complete."""
        function, changed = (
            self.block.function,
            {one.text for each in statements_in(self._statements) for one in each.changed},
        )
        changed.add("%history")  # which all steps have, and some leave alone
        unchanged = (index for index, one in enumerate(function.args) if one.text not in changed)
        self.module.unchanged[function.name] = frozenset(unchanged)
        text = FunctionText(
            function,
            self._statements,
            self._locals,
            self._hints,
            self.module.size,
            self.module.unchanged[function.name],
        )
        self.module.texts.append(text.function(self._tables))

    def loop(self, first: Value, beyond: Value, body: Callable[[Value], object]) -> None:
        """Emit `body` for every index from `first` to before `beyond`."""
        if first.is_constant and beyond.is_constant:
            if int(first.text) >= int(beyond.text):
                return
            if int(first.text) + 1 == int(beyond.text):
                body(first)
                return
        index = Value(INT, f"%{'ijklmn'[self._depth]}")
        name = index.text[1:]
        end = self._count(int(beyond.text)) if first.text == "0" and beyond.is_constant else "{1}"
        statement = Statement(f"for ({name} = {{0}}; {name} < {end}; {name}++)", (first, beyond), writes=True)
        self._locals[index.text] = Local("int64_t", None)
        self._depth += 1
        with self._within(statement):
            body(index)
        self._depth -= 1

    def repeat(self, first: Value, body: Callable[[Value], Value]) -> None:
        """Emit `body`, which takes a number that grows from `first` on, until the condition that it returns fails."""
        count = self.alloca(first.type, name="count")
        self.store(first, count)
        statement = Statement("do", (), writes=True)
        with self._within(statement):
            more = body(self.load(count, typ=INT))
            held = self.alloca(BOOL, name="more")
            self.store(more, held)
            self.store(self.add(self.load(count, typ=INT), integer(1)), count)
        statement.operands, statement.template = (held,), "do|while ({0});"

    def _count(self, number: int) -> str:
        return "SIZE" if number == self.module.size else str(number)

    @contextmanager
    def _within(self, statement: Statement, append: bool = True) -> Iterator[None]:  # type: ignore[override]
        body: list[Statement] = []
        if append:
            self._open.append(statement)
        statement.bodies.append(body)
        outer, self._open = self._open, body
        yield
        self._open = outer

    @contextmanager
    def if_then(self, condition: Value, likely: bool | None = None) -> Iterator[None]:
        """What is emitted within is executed if a condition holds."""
        statement = Statement("if ({0})", (condition,), writes=True)
        if condition.is_constant:
            statement.bodies = [self._open if condition.text == "true" else []]
            outer, self._open = self._open, statement.bodies[0]
            yield
            self._open = outer
            return
        with self._within(statement):
            yield

    @contextmanager
    def if_else(
        self, condition: Value, likely: bool | None = None
    ) -> Iterator[tuple[AbstractContextManager[None], AbstractContextManager[None]]]:
        """Two contexts: what is emitted within the first is executed if a condition holds, otherwise the second."""
        statement = Statement("if ({0})|else", (condition,), writes=True, bodies=[[], []])
        self._open.append(statement)

        @contextmanager
        def part(body: list[Statement]) -> Iterator[None]:
            outer, self._open = self._open, body
            yield
            self._open = outer

        yield part(statement.bodies[0]), part(statement.bodies[1])


def _with_operands(operation: tuple[str, int], x: Value, y: Value) -> tuple[str, tuple[Value, Value], int]:
    return operation[0], (x, y), operation[1]


def _call(name: str, count: int) -> str:
    return f"{name}({', '.join(f'{{{index}}}' for index in range(count))})"


PROJECTION = """\
static void project_in_place(double t, double *y, const double *in)
{
    double projected[SIZE];

    projection(t, y, in, projected);
    memcpy(y, projected, sizeof projected);
}"""


def step_functions(model: ExportedModel) -> list[str]:
    """The texts of rates and projection, and of `static void step_METHOD(…)` for each method, with what it calls."""
    equations = model.equations
    module = CModule(len(model.states))
    program, margin = arranged(equations.rates), ["margin"] * (equations.rates.n_out() > 1)
    rates = _listed(module, program, "rates", ("t", "y", "in"), ("out", *margin))
    module.texts[-1] = f"/* y' of the equations of motion. */\n{module.texts[-1]}"
    projection = None
    if equations.project is not None:
        _listed(module, arranged(equations.project, fused=False), "projection", ("t", "y", "in"), ("out",))
        module.texts.append(PROJECTION)
        module.unchanged["project_in_place"] = frozenset({2})
        projection = Function(module, FunctionType(VOID, [DOUBLE, POINTER, POINTER]), "project_in_place")
    between = model.between_steps
    system = System(
        size=len(model.states),
        error_size=equations.core.stop,
        rates=rates,
        projection=projection,
        reports_conditioning=bool(margin),
        projection_takes_inputs=True,
        projects_in_place=True,
        held=frozenset() if between is None else between.held,
        inputs_size=equations.inputs.size,
        instructions=instruction_count(program),
        scales=equations.scales,
    )
    sample = _sample(module, model)
    for method in model.methods:
        _step(module, system, model, method, sample)
    return module.texts


def _listed(
    module: CModule, function: Instructions, name: str, arguments: Sequence[str], results: Sequence[str]
) -> Function:
    """A function of an instruction list, whose arguments t and g are numbers."""
    module.texts.append(c_function(function, name, arguments, results, ("t", "g")))
    types = [DOUBLE if argument in ("t", "g") else POINTER for argument in arguments]
    module.unchanged[name] = frozenset(range(len(arguments)))
    return Function(module, FunctionType(VOID, [*types, *[POINTER] * len(results)]), name)


def _sample(module: CModule, model: ExportedModel) -> Function | None:
    """`static void sample(int64_t index, double t, double *y, const double *in)`: what changes before a step."""
    if (between := model.between_steps) is None:
        return None
    sampled = [
        (sampler, _listed(module, sampler.function, f"sampled_{number}", ("t", "y", "in"), ("out",)))
        for number, sampler in enumerate(between.samplers)
    ]
    samples = ChangesBetweenSteps(between.delays, sampled)
    types = [INT, DOUBLE, POINTER, POINTER]
    function = Function(module, FunctionType(VOID, types), "sample", ("index", "t", "y", "in"))
    function.about = "Delayed commands move on, and sampled controllers act."
    index, *arguments = function.args
    b = CBuilder(function.append_basic_block("entry"))
    samples.emit(b, index, arguments, samples.results(b))
    b.ret_void()
    return function


def _step(module: CModule, system: System, model: ExportedModel, method: Method, sample: Function | None) -> None:
    equations = model.equations

    def emit(function: ca.Function, arguments: Sequence[str], results: Sequence[str]) -> Function:
        return _listed(module, function, function.name(), arguments, results)

    types = [INT, DOUBLE, DOUBLE, DOUBLE, POINTER, POINTER, POINTER]
    names = ("index", "t", "t_next", "h", "y", "in", "history")
    function = Function(module, FunctionType(VOID, types), f"step_{method.name}", names)
    function.about = f"A step of {method.name}, order {method.order}, from the time t to t_next = t + h."
    index, t, t_next, h, y, inputs, history = function.args
    b = CBuilder(function.append_basic_block("entry"))
    emitter = StepEmitter(b, system, inputs, h, y, estimates=False)
    emitter.index, emitter.steps, emitter.history = index, integer(1), history
    needs = StepNeeds(equations.rates, equations.core, lambda: equations.joint_linearization.partial_system, emit)
    step = step_of(method, needs)(emitter)
    if emitter.kept is not None:
        emitter.kept.begin()
    if sample is not None:
        b.call(sample, [index, t, y, inputs])
    step(t)
    emitter.project(t_next, y)
    emitter.index = b.add(index, integer(1))
    if emitter.kept is not None:
        emitter.kept.end(Value(BOOL, "true"))
    b.ret_void()
