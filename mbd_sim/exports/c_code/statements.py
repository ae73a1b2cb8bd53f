"""The text of a C function from its statements, which a builder has collected.

Values that are used once become parts of expressions, as long as nothing between changes the memory that they read.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from mbd_sim.compiler.ir.builder import DOUBLE, INT
from mbd_sim.compiler.ir.module import BOOL, POINTER, Function, Type, Value
from mbd_sim.exports.c_code.functions import literal

TYPES = {DOUBLE: "double", INT: "int64_t", BOOL: "int", POINTER: "double *"}
# How tightly operators bind. C compilers warn of mixed ones below `SUM` without parentheses.
CHOICE, EITHER, BOTH, COMPARISON, BITS, SUM, PRODUCT, SIGN, NAME = range(9)


@dataclass
class Statement:
    """An instruction: an expression or a statement of its operands, with blocks of its own if it is a loop or branch.

    `result` is its value, if it has one. It `reads` or `writes` memory, or neither.
    """

    template: str
    operands: Sequence[Value]
    result: Value | None = None
    level: int = NAME
    reads: bool = False
    writes: bool = False
    bodies: list[list[Statement]] = field(default_factory=list)
    target: Value | None = None  # of a store, the array
    changed: Sequence[Value] = ()  # the arrays that it may change


@dataclass(frozen=True)
class Local:
    """A variable or an array of a function."""

    type: str
    size: int | None


@dataclass(frozen=True)
class _Expression:
    """Text that is not written yet; `reads` says whether it depends on memory."""

    text: str
    level: int
    type: Type
    reads: bool


class FunctionText:
    """The text of a function from its statements."""

    def __init__(
        self,
        function: Function,
        statements: list[Statement],
        variables: dict[str, Local],
        hints: dict[str, str],
        size: int,
        unchanged: frozenset[int],
    ) -> None:
        self._function, self._statements, self._variables, self._size = function, statements, variables, size
        self._unchanged, self._hints = unchanged, hints
        self._taken = {argument.text[1:] for argument in function.args} | {name[1:] for name in variables}
        self._uses: Counter[str] = Counter()
        self._inside: dict[str, int] = {}  # the list of statements in which a value is used last
        self._names: dict[str, str] = {}
        self._lines: list[str] = []

    def function(self, tables: Sequence[str]) -> str:
        """The whole text."""
        while self._leave_out_unused(self._statements):
            pass
        self._count(self._statements)
        self._write(self._statements, "    ", {})
        declared = self._declarations()
        unused = [f"    (void){a.text[1:]};" for a in self._function.args if not self._uses[a.text]]
        used_tables = [line for line in tables if self._uses["%" + line.split("double ")[1].split("[")[0]]]
        head = self._signature()
        body = [*used_tables, *declared, *([""] if declared or used_tables else []), *unused, *self._lines]
        about = [f"/* {self._function.about} */"] if self._function.about else []
        return "\n".join([*about, *head, "{", *body, "}"])

    def _signature(self) -> list[str]:
        kinds = []
        for index, argument in enumerate(self._function.args):
            constant = "const " if argument.type == POINTER and index in self._unchanged else ""
            kinds.append(f"{constant}{TYPES[argument.type]} ".replace("* ", "*") + argument.text[1:])
        line = f"static void {self._function.name}({', '.join(kinds)})"
        if len(line) <= 120:
            return [line]
        return [f"static void {self._function.name}(", f"    {', '.join(kinds)})"]

    def _declarations(self) -> list[str]:
        kinds: dict[str, list[str]] = {}
        for name, one in self._variables.items():
            if self._uses[name]:
                size = "" if one.size is None else f"[{'SIZE' if one.size == self._size else one.size}]"
                kinds.setdefault(one.type, []).append(f"{name[1:]}{size}")
        lines = []
        for kind, names in kinds.items():
            line = f"    {kind} {names[0]}"
            for name in names[1:]:
                if len(line) + len(name) > 115:
                    lines.append(f"{line};")
                    line = f"    {kind} {name}"
                else:
                    line += f", {name}"
            lines.append(f"{line};")
        return lines

    def _leave_out_unused(self, statements: list[Statement]) -> bool:
        """Leave out values, and stores to variables, that nothing uses; returns whether there were any."""
        self._uses = Counter()
        self._count(self._statements)
        read: Counter[str] = Counter(self._uses)
        for statement in statements_in(self._statements):
            if statement.target is not None:
                read[statement.target.text] -= 1
        return _without(
            statements,
            lambda one: (
                (one.result is not None and not self._uses[one.result.text])
                or (one.target is not None and one.target.text in self._variables and not read[one.target.text])
                or bool(one.bodies and not any(one.bodies))
            ),
        )

    def _count(self, statements: list[Statement]) -> None:
        if statements is self._statements:
            self._uses.clear()
        for statement in statements:
            for operand in statement.operands:
                self._uses[operand.text] += 1
                self._inside[operand.text] = id(statements)
            if statement.template.startswith("for ("):
                self._uses[f"%{statement.template[5]}"] += 1
            for body in statement.bodies:
                self._count(body)

    def _write(self, statements: list[Statement], indent: str, pending: dict[str, _Expression]) -> None:

        def write_out(names: Sequence[str]) -> None:
            for name in names:
                one = pending.pop(name)
                self._lines.append(f"{indent}{self._defined(name, one)}")

        for statement in statements:
            if statement.template.startswith("for ("):  # whose bounds must not change within
                write_out([name for name, one in pending.items() if one.reads])
            taken, texts = [], []
            levels = self._levels(statement)
            for operand, level in zip(statement.operands, levels, strict=True):
                one = pending.pop(operand.text, None)
                if one is None:
                    texts.append(self._text(operand))
                else:
                    taken.append(one)
                    texts.append(one.text if one.level >= level else f"({one.text})")
            text = statement.template.format(*texts)
            if statement.result is not None:
                name = statement.result.text
                reads = statement.reads or any(one.reads for one in taken)
                found = _Expression(text, statement.level, statement.result.type, reads)
                if (
                    name not in self._hints
                    and self._uses[name] == 1
                    and (not reads or self._inside[name] == id(statements))
                ):
                    pending[name] = found
                else:
                    self._lines.append(f"{indent}{self._defined(name, found)}")
                continue
            if statement.writes:
                write_out([name for name, one in pending.items() if one.reads])
            if statement.bodies:
                self._write_blocks(text, statement.bodies, indent, pending)
            else:
                self._lines.append(f"{indent}{text}")

    def _write_blocks(
        self, text: str, bodies: list[list[Statement]], indent: str, pending: dict[str, _Expression]
    ) -> None:
        heads = text.split("|")
        if heads[0] == "do":
            heads, tail = ["do"], heads[1]
        else:
            tail = ""
        for head, body in zip(heads, bodies, strict=False):
            if head == "else":
                if not body:
                    continue
                if self._lines[-1] == f"{indent}}}":
                    self._lines[-1] += f" {head} {{"
                else:
                    self._lines.append(f"{indent}{head} {{")
            else:
                self._lines.append(f"{indent}{head} {{")
            start = len(self._lines)
            self._write(body, f"{indent}    ", pending)
            if len(self._lines) == start + 1 and len(heads) == 1 and not tail:
                self._lines[start - 1] = self._lines[start - 1].removesuffix(" {")
            else:
                self._lines.append(f"{indent}}}")
        if tail:
            self._lines[-1] += f" {tail}"

    def _levels(self, statement: Statement) -> list[int]:
        """How tightly each operand must bind."""
        count, level, template = len(statement.operands), statement.level, statement.template
        if template.startswith(("{0}[", "{0} =")):
            return [NAME, *[0] * (count - 1)]
        if level == NAME or statement.result is None:
            return [0] * count
        if level == SIGN:
            return [SUM if template.startswith("!(") else SIGN + (template == "-{0}")] * count
        if level == CHOICE:
            return [EITHER + 1, BITS, BITS]
        if level in (EITHER, BOTH):
            return [COMPARISON, COMPARISON] if level == EITHER else [BOTH, BOTH]
        if level == BITS:
            return [SIGN, SIGN]
        return [SUM if level == COMPARISON else level, SUM if level == COMPARISON else level + 1]

    def _defined(self, name: str, one: _Expression) -> str:
        kind = TYPES.get(one.type, one.type)
        chosen = hint = self._hints.get(name, "v1")
        number = 1
        while chosen in self._taken:
            number += 1
            chosen = f"{hint}_{number}" if name in self._hints else f"v{number}"
        self._taken.add(chosen)
        self._names[name] = chosen
        const = f"{kind}const " if kind.endswith("*") else f"const {kind} "
        return f"{const}{self._names[name]} = {one.text};"

    def _text(self, value: Value) -> str:
        if not value.is_constant:
            return self._names.get(value.text, value.text[1:])
        if value.type == DOUBLE:
            return literal(struct.unpack(">d", bytes.fromhex(value.text[2:]))[0])
        return {"true": "1", "false": "0"}.get(value.text, value.text)


def statements_in(statements: list[Statement]) -> Iterator[Statement]:
    """The statements of a list and of the lists within."""
    for statement in statements:
        yield statement
        for body in statement.bodies:
            yield from statements_in(body)


def _without(statements: list[Statement], is_unused: Callable[[Statement], bool]) -> bool:
    """Remove statements from a list and the lists within; returns whether there were any."""
    unused = [statement for statement in statements if is_unused(statement)]
    statements[:] = [statement for statement in statements if not is_unused(statement)]
    inner = [_without(body, is_unused) for statement in statements for body in statement.bodies]
    return bool(unused) or any(inner)
