"""LLVM's intermediate language (IR), written as text: the part of `llvmlite.ir` that the emitters use, and its names.

`llvmlite.ir` keeps an object for each instruction and prints it in the end, which takes longer than LLVM's compilation
of the same code. Here an instruction is a line of text from the start. LLVM checks types when it reads the text. The
LLVM Language Reference Manual, https://llvm.org/docs/LangRef.html, describes the instructions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, NamedTuple, TypeAlias

Type: TypeAlias = str  # as LLVM writes it: double, i64, ptr, <8 x double>

ALWAYS_INLINE = "alwaysinline"
LARGE = 300  # lines of a function from which on it is a unit of its own
UNROLLED = 40  # components up to which operations on state vectors are unrolled into registers

VOID, BOOL, POINTER = "void", "i1", "ptr"

_NAMED = re.compile('@"([^"]+)"')  # a function, a variable or a table


class Value(NamedTuple):
    """A constant, an argument or the result of an instruction; `text` is how instructions refer to it."""

    type: Type
    text: str

    @property
    def is_constant(self) -> bool:
        """Whether it is known when the code is compiled."""
        return not self.text.startswith("%")


class Phi(Value):
    """A value that depends on the block from which its own block is reached."""

    def __init__(self, *_: str) -> None:
        self._incoming: list[str] = []

    def add_incoming(self, value: Value, block: BasicBlock) -> None:
        """The value if its block is reached from `block`."""
        self._incoming.append(f"[ {value.text}, %{block.name} ]")

    def __str__(self) -> str:
        return f"  {self.text} = phi {self.type} {', '.join(self._incoming)}"


@dataclass(frozen=True, slots=True)
class FunctionType:
    """The types of a function's result and arguments."""

    result: Type
    args: Sequence[Type]


class BasicBlock:
    """A sequence of instructions, of which the last one, the terminator, says what follows."""

    def __init__(self, function: Function, name: str) -> None:
        self.function, self.name = function, name
        self.lines: list[str | Phi] = []
        self.is_terminated = False

    def __str__(self) -> str:
        return "\n".join([f"{self.name}:", *map(str, self.lines)])


class Function:
    """A function of a module, which without blocks is only declared; `attributes` and `linkage` are LLVM's.

    With `noalias`, what one of its pointers leads to is reached through no other one. `arguments` are their names,
    and `about` is for readers of generated C.
    """

    def __init__(
        self, module: Module, function_type: FunctionType, name: str, arguments: Sequence[str] | None = None
    ) -> None:
        self.module, self.function_type, self.name = module, function_type, name
        names = [f"a{index}" for index in range(len(function_type.args))] if arguments is None else arguments
        self.args = tuple(Value(type_, f"%{own}") for type_, own in zip(function_type.args, names, strict=True))
        self.linkage = self.about = ""
        self.attributes: list[str] = []
        self.noalias = False
        self.blocks: list[BasicBlock] = []
        self.numbers = count()  # of values and blocks
        self.allocated: list[Value] = []  # memory that is freed where it returns
        module.add(name, self)

    @property
    def is_inlined(self) -> bool:
        """Whether it is inlined wherever it is called."""
        return ALWAYS_INLINE in self.attributes

    def append_basic_block(self, name: str) -> BasicBlock:
        """A new block after all others."""
        self.blocks.append(BasicBlock(self, f"{name}.{next(self.numbers)}"))
        return self.blocks[-1]

    @property
    def declaration(self) -> str:
        """The line that declares it where it is defined elsewhere."""
        return f"declare {self._signature}"

    def __str__(self) -> str:
        if not self.blocks:
            return self.declaration
        return "\n".join([f"define {self.linkage} {self._signature} {{", *map(str, self.blocks), "}"])

    @property
    def _signature(self) -> str:
        pointer = f"{POINTER} noalias" if self.noalias else POINTER
        types = (pointer if argument.type == POINTER else argument.type for argument in self.args)
        arguments = ", ".join(f"{type_} {argument.text}" for type_, argument in zip(types, self.args, strict=True))
        return f'{self.function_type.result} @"{self.name}"({arguments}) {" ".join(self.attributes)}'


class Module:
    """The functions and variables that are compiled together, by name.

    If the code `is_fast`, it takes longer to compile: small functions are inlined, and operations on vectors of up to
    `unrolled` components are unrolled; those on longer ones are loops. `new_builder` writes into a block.
    """

    def __init__(self, triple: str, new_builder: Callable[[BasicBlock], Any], *, is_fast: bool = True) -> None:
        self.triple, self.new_builder, self.fast = triple, new_builder, is_fast
        self.unrolled = UNROLLED if self.fast else 0
        self.functions: dict[str, Function] = {}
        self._variables: dict[str, Type] = {}
        self._tables: dict[str, Sequence[int]] = {}

    def add(self, name: str, function: Function) -> None:
        """Add a function.

        :raises ValueError: there is one of that name.
        """
        if name in self.functions:
            raise ValueError(f"the function '{name}' is defined twice")
        self.functions[name] = function

    def declared(self, name: str, result: Type, arguments: Sequence[Type]) -> Function:
        """A function that is defined elsewhere."""
        return self.functions.get(name) or Function(self, FunctionType(result, arguments), name)

    def external(self, name: str, type_: Type) -> Value:
        """The address of a variable that is defined elsewhere."""
        self._variables[name] = type_
        return Value(POINTER, f'@"{name}"')

    def table(self, name: str, numbers: Sequence[int]) -> Value:
        """The address of constant 64-bit integers."""
        self._tables[name] = numbers
        return Value(POINTER, f'@"{name}"')

    def __str__(self) -> str:
        return "\n".join([*self._header(), *map(str, self.functions.values()), ""])

    def units(self) -> list[str]:
        """The module as texts to compile apart: each `LARGE` function is one, and all others together are one.

        The steps of a method depend on the sizes of a system only, so that they need not be compiled again where its
        equations have changed. Functions that are inlined are in each unit that calls them.
        """
        texts = {name: str(function) for name, function in self.functions.items()}
        uses = {name: dict.fromkeys(_NAMED.findall(text)) for name, text in texts.items()}
        own = [name for name, function in self.functions.items() if function.blocks and not function.is_inlined]
        large = [name for name in own if texts[name].count("\n") >= LARGE]
        groups = [[name] for name in large], [name for name in own if name not in large]
        return [self._unit(group, texts, uses) for group in (*groups[0], groups[1]) if group]

    def _unit(self, names: Sequence[str], texts: Mapping[str, str], uses: Mapping[str, Iterable[str]]) -> str:
        """The text of functions, with the bodies of inlined functions that they call, and declarations of others."""
        found, waiting = set(names), [*names]
        used = set[str]()
        while waiting:
            further = set(uses[waiting.pop()]) - found
            used |= further
            inlined = [name for name in further if name in self.functions and self.functions[name].is_inlined]
            found.update(inlined)
            waiting += inlined
        lines = self._header(used)
        for name, function in self.functions.items():
            if name in found:
                lines.append(texts[name] if function.is_inlined else texts[name].replace("internal ", "", 1))
            elif name in used:
                lines.append(function.declaration)
        return "\n".join([*lines, ""])

    def _header(self, used: Collection[str] | None = None) -> list[str]:
        """The lines before the functions: the processor and the variables, or those that are used."""
        lines = [f'target triple = "{self.triple}"']
        for name, type_ in self._variables.items():
            if used is None or name in used:
                lines.append(f'@"{name}" = external global {type_}')
        for name, numbers in self._tables.items():
            if used is None or name in used:
                entries = ", ".join(f"i64 {entry}" for entry in numbers)
                lines.append(f'@"{name}" = internal constant [{len(numbers)} x i64] [{entries}]')
        return lines


def vector_of(scalar: Type, lanes: int) -> Type:
    """The type of a vector."""
    return f"<{lanes} x {scalar}>"


def is_vector(type_: Type) -> bool:
    """Whether a type is that of vectors."""
    return type_.startswith("<")


def scalar_of(type_: Type) -> Type:
    """The type of the entries of vectors."""
    return type_.partition(" x ")[2].removesuffix(">")


def with_lanes_of(type_: Type, scalar: Type) -> Type:
    """A scalar type, or the type of vectors of such scalars with as many lanes as `type_` has."""
    return f"{type_.partition(' ')[0]} x {scalar}>" if is_vector(type_) else scalar


def undefined(type_: Type) -> Value:
    """Any value of a type."""
    return Value(type_, "undef")
