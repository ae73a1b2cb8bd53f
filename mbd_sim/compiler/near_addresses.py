"""Shorter addresses in long machine code for x86-64: registers that are free point near what is accessed next.

Half of the instructions of a long function access the stack or constants. LLVM addresses these by their distances
from the frame pointer and from the code, in four bytes. One byte is enough for a distance of less than 128 from a
register. A processor fetches and decodes only so many bytes in a cycle, which limits code longer than its cache.

LLVM has no such pass for this processor, so this one works on the assembly code that LLVM writes. Instructions only
name their operands in memory in another way: all results remain the same.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import accumulate, chain
from typing import NamedTuple, TypeAlias

from mbd_sim.compiler.memory_order import SECTION, SIZES, OrderedConstants, with_ordered_stack

REACH = 128  # bytes before a register's address, and less one after it, that a distance of one byte reaches
GRAIN = 8  # bytes, of which places of constants and of numbers on the stack are multiples
WIDTH = 2 * REACH // GRAIN  # places in reach of a register
AHEAD = 400  # accesses that are counted to decide where a register is to point
PAYS = 6  # accesses for which a register is set: that takes up to seven bytes, and each access saves three
FEW = 100  # accesses of a function that are not worth the effort
# Registers that a function need not restore, with the names of their parts. Of instructions with the last four, half
# are longer by a byte.
REGISTERS = {
    "rax": ("eax", "ax", "al", "ah"),
    "rcx": ("ecx", "cx", "cl", "ch"),
    "rdx": ("edx", "dx", "dl", "dh"),
    "rsi": ("esi", "si", "sil"),
    "rdi": ("edi", "di", "dil"),
    "r8": ("r8d", "r8w", "r8b"),
    "r9": ("r9d", "r9w", "r9b"),
    "r10": ("r10d", "r10w", "r10b"),
    "r11": ("r11d", "r11w", "r11b"),
}
_WHOLE = {part: name for name, parts in REGISTERS.items() for part in (name, *parts)}
# Instructions that do not jump, and use no registers but those that they name; calls may use all of them.
_KNOWN = re.compile(r"v[a-z0-9]+|mov[a-z]*|lea[lq]|(push|pop)q?|(add|sub|and|or|xor)[bwlq]|(call|ret)q?")
# Instructions that set or save the register of the frame pointer, and all of them where it is one.
_SETS_FRAME = ("%rbp", "%ebp", "%bp", "%bpl")
_FRAME = {("pushq", "%rbp"), ("movq", "%rsp,", "%rbp"), ("popq", "%rbp")}
_OPERAND = re.compile(r"(-?\d*)\(%rbp\)|(\.LCPI\w+)(?:\+(\d+))?\(%rip\)")
_REGISTER = re.compile(r"%([a-w][a-z0-9]*)")  # those of vectors begin with x, y or z, and are none of `REGISTERS`
_CONSTANTS = re.compile(rf"\.section\s+(\.rodata\.cst\d+|{re.escape(SECTION)}),")
_SECTIONS = frozenset({".section", ".text", ".data", ".bss"})

Constants: TypeAlias = Mapping[str, tuple[str, int]]  # of each label the section, and the distance from its start


class _Operand(NamedTuple):
    """What an instruction accesses: a distance in bytes from the frame pointer, or from the start of a section."""

    line: int
    section: str  # empty for the stack
    distance: int
    name: str  # the label and what is added to it; empty for the stack

    def address(self, more: int) -> str:
        """The address so many bytes after this operand."""
        return f"{self.name}{more:+d}(%rip)" if self.section else f"{self.distance + more}(%rbp)"


class _Body(NamedTuple):
    """A function without jumps: its lines, and for each register the line from which on it is free."""

    lines: Sequence[str]
    calls: Sequence[int]
    free: Mapping[str, int]


def with_near_addresses(assembly: str, functions: Collection[str]) -> str:
    """The same assembly code, of which some functions are shorter.

    :param assembly: as LLVM writes it, in AT&T syntax.
    :param functions: the names of functions that return nothing.
    """
    lines = assembly.splitlines()
    ordered = OrderedConstants(lines)
    pieces: list[Sequence[str] | _Body] = []
    for piece, is_function in _pieces(lines, functions):
        body = _body(piece) if is_function else None
        if body is not None:
            body = body._replace(lines=ordered.ordered(with_ordered_stack(piece)))
        pieces.append(piece if body is None else body)
    end = ordered.lines()
    constants = _constants([*(line for piece in pieces if not isinstance(piece, _Body) for line in piece), *end])
    shortened = (_shortened(piece, constants) if isinstance(piece, _Body) else piece for piece in pieces)
    return "\n".join([*chain.from_iterable(shortened), *end, ""])


def _pieces(lines: Sequence[str], functions: Collection[str]) -> Iterator[tuple[Sequence[str], bool]]:
    """The lines of some functions, and those before and after them, each with whether it is such a function."""
    begin = position = 0
    while position < len(lines):
        name, colon, _ = lines[position].partition(":")
        position += 1
        if colon and name.strip('"') in functions:
            yield lines[begin:position], False
            begin, position = (
                position,
                next(i for i in range(position, len(lines)) if lines[i].startswith(".Lfunc_end")),
            )
            yield lines[begin:position], True
            begin = position
    yield lines[begin:], False


def as_module(assembly: str, triple: str) -> str:
    """A module of IR whose object code is that of assembly code for a target."""
    texts = [line.replace("\\", "\\5C").replace('"', "\\22").replace("\t", "\\09") for line in assembly.splitlines()]
    return "\n".join([f'target triple = "{triple}"', *[f'module asm "{text}"' for text in texts], ""])


def _constants(lines: Sequence[str]) -> Constants:
    """The places of all constants in sections of which every line is known."""
    found: dict[str, tuple[str, int]] = {}
    sizes: dict[str, int] = {}
    unknown = {""}
    section = ""
    for words in filter(None, (line.split() for line in lines)):
        if words[0] in _SECTIONS:
            match = _CONSTANTS.match(" ".join(words))
            section = match[1] if match else ""
        elif section not in unknown:
            size = sizes.get(section, 0)
            if words[0].endswith(":"):
                found[words[0][:-1]] = section, size
            elif words[0] == ".p2align":
                step = 1 << int(words[1].rstrip(","))
                sizes[section] = -(-size // step) * step
            elif words[0] == ".zero":
                sizes[section] = size + int(words[1].partition(",")[0])
            elif words[0] in SIZES:
                sizes[section] = size + SIZES[words[0]]
            else:
                unknown.add(section)
    return {label: place for label, place in found.items() if place[0] not in unknown}


def _shortened(body: _Body, constants: Constants) -> Sequence[str]:
    operands = _operands(body.lines, constants)
    return body.lines if len(operands) < FEW else _Pointers(body, operands).lines()


def _body(lines: Sequence[str]) -> _Body | None:
    """The function with these lines; None if it has jumps, unknown instructions, or no frame pointer."""
    calls: list[int] = []
    used = dict.fromkeys(REGISTERS, -1)
    frame = set[tuple[str, ...]]()
    known: set[str] = set()
    for number, line in enumerate(lines):
        code = line.partition("#")[0].strip()
        if not code or (code[0] == "." and not code.endswith(":")):
            continue
        operation = code.split(None, 1)[0]
        if operation not in known:
            if code.endswith(":") or not _KNOWN.fullmatch(operation):
                return None
            known.add(operation)
        if operation.startswith("call"):
            calls.append(number)
        if code.endswith(_SETS_FRAME):
            frame.add(tuple(code.split()))
        for name in _REGISTER.findall(code):
            if name in _WHOLE:
                used[_WHOLE[name]] = number
    if frame != _FRAME:  # the register may hold something else, which changes
        return None
    # A register may hold an argument of the next call; if the function does not name it, one of the first call.
    free = {name: next((call for call in calls if call >= last), last) + 1 for name, last in used.items()}
    return _Body(lines, calls, free)


def _operands(lines: Sequence[str], constants: Constants) -> list[_Operand]:
    """What instructions access out of reach of the frame pointer, where the place is known."""
    found = (
        _operand(number, match, constants)
        for number, line in enumerate(lines)
        if "(%r" in line and (match := _OPERAND.search(line)) and not line.lstrip().startswith(("lea", "#"))
    )
    return [operand for operand in found if operand is not None]


def _operand(line: int, match: re.Match[str], constants: Constants) -> _Operand | None:
    """An operand on the stack or a constant, unless it is near or its place is not known."""
    distance, label, more = match.groups()
    if label is None:
        own = int(distance or 0)
        return None if -REACH <= own < REACH or own % GRAIN else _Operand(line, "", own, "")
    if label not in constants:
        return None
    section, start = constants[label]
    own = start + int(more or 0)
    return None if own % GRAIN else _Operand(line, section, own, f"{label}+{more or 0}")


class _Pointers:
    """Where registers point, from the first operand to the last one.

    All operands have a place on one axis, in steps of `GRAIN`: the stack and the sections, out of reach of each other.
    """

    def __init__(self, body: _Body, operands: Sequence[_Operand]) -> None:
        self._body, self._operands = body, operands
        self._places = _places(operands)
        self._waiting = [0] * (max(self._places) + 2 * WIDTH)  # at each place, accesses of those that are counted
        self._first: dict[str, int] = {}  # for each register that points somewhere, the first place in its reach

    def lines(self) -> list[str]:
        """The lines of the function with shorter addresses."""
        body, counted, call = self._body, 0, 0
        calls = [*body.calls, len(body.lines)]
        changed: dict[int, list[str]] = {}
        for index, (operand, place) in enumerate(zip(self._operands, self._places, strict=True)):
            while calls[call] < operand.line:
                call += 1
                self._first.clear()
            ahead = min(index + AHEAD, len(self._places))
            while counted < ahead and self._operands[counted].line < calls[call]:
                self._waiting[self._places[counted]] += 1
                counted += 1
            register = None
            for name, first in self._first.items():
                if first <= place < first + WIDTH:
                    register = name
                    break
            before = []
            if register is None and (register := self._pointed(operand.line, place)) is not None:
                more = (self._first[register] - place) * GRAIN + REACH
                before = [f"\tleaq\t{operand.address(more)}, %{register}"]
            if register is not None:
                distance = (place - self._first[register]) * GRAIN - REACH
                short = _OPERAND.sub(f"{distance}(%{register})", body.lines[operand.line])
                changed[operand.line] = [*before, short]
            self._waiting[place] -= 1
        return [text for number, line in enumerate(body.lines) for text in changed.get(number, [line])]

    def _pointed(self, line: int, place: int) -> str | None:
        """A register that now points near a place, if that pays."""
        low = place - WIDTH + 1
        counts = self._waiting[low : place + WIDTH]  # of what no register reaches
        if sum(counts) < PAYS:
            return None
        for first in self._first.values():
            begin, end = max(first - low, 0), min(first + WIDTH - low, len(counts))
            if begin < end:
                counts[begin:end] = [0] * (end - begin)
        sums = list(accumulate(counts, initial=0))
        gains = [after - before for before, after in zip(sums, sums[WIDTH:], strict=False)]
        most = gain = max(gains)
        if gain < PAYS:
            return None
        usable = [name for name, start in self._body.free.items() if start <= line]
        register = next((name for name in usable if name not in self._first), None)
        if register is None and usable:
            reached = {name: sum(self._waiting[first : first + WIDTH]) for name, first in self._first.items()}
            register = min(reached, key=reached.__getitem__)
            gain -= reached[register]
        if register is None or gain < PAYS:
            return None
        self._first[register] = low + gains.index(most)
        return register


def _places(operands: Sequence[_Operand]) -> list[int]:
    """The places of operands."""
    spans: dict[str, tuple[int, int]] = {}
    for _, section, distance, _ in operands:
        low, high = spans.get(section, (distance, distance))
        spans[section] = min(low, distance), max(high, distance)
    starts, end = {}, WIDTH
    for section, (low, high) in spans.items():
        starts[section] = end - low // GRAIN
        end += (high - low) // GRAIN + 2 * WIDTH
    return [starts[section] + distance // GRAIN for _, section, distance, _ in operands]
