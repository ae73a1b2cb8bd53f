"""Values on the stack and constants of long machine code for x86-64, in about the order in which it accesses them.

LLVM gives values places on the stack, and constants in memory, regardless of when they are used. Where those used one
after the other are neighbours, a register that points there serves more accesses: see `near_addresses`.
"""

from __future__ import annotations

import functools
import heapq
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

CELL = 8  # bytes, the unit in which memory is shared
PAIR = 16  # bytes, to which values of this size or more are aligned, as is the frame pointer
LONG_LIVED = 2000  # instructions: what waits longer gets places of its own, so that the others are close together
AGAIN = 40  # accesses to constants after which one that is used again is stored again
SECTION = ".rodata.ordered"
SIZES = {".quad": 8, ".long": 4, ".short": 2, ".byte": 1}  # of the numbers that a directive defines, bytes

_FRAME_OPERAND = re.compile(r"(-?\d*)\(%rbp\)")
_CONSTANT_OPERAND = re.compile(r"(\.LCPI\d+_\d+)(?:\+(\d+))?\(%rip\)")
_FRAME = frozenset({"pushq\t%rbp", "movq\t%rsp, %rbp", "popq\t%rbp"})
_FRAME_SIZE = re.compile(r"(subq|addq)\t\$(\d+), %rsp")
# Instructions that access half of a vector of two, whatever else they name.
_HALVES = frozenset({"vmovddup", "vmovhpd", "vmovlpd", "vmovhps", "vmovlps"})
_PAIRS = frozenset({"vinsertf128", "vextractf128", "vbroadcastf128"})
_STORES = re.compile(r"v?mov|vextract")
# On two or four numbers at once, and on one; conversions and those with 16 or 32 bits are not among them.
_WIDE = re.compile(
    r"v(mov[au]|add|sub|mul|div|sqrt|xor|and|andn|or|shuf|perm|permil|unpckl|unpckh|fn?m(add|sub)\d+)p[ds]|vblendv?pd"
)
_SINGLE = re.compile(r"v(mov|add|sub|mul|div|sqrt|broadcast|fn?m(add|sub)\d+)sd")

Entries: TypeAlias = Sequence[tuple[int, str]]  # of a constant: sizes in bytes, and the lines that define them


class _Access(NamedTuple):
    """An instruction that accesses the stack, at a distance from the frame pointer."""

    line: int
    distance: int
    size: int
    is_store: bool


class _Cluster(NamedTuple):
    """Accesses to the same numbers: the stores, and the loads of what they stored."""

    low: int
    high: int
    accesses: Sequence[_Access]

    @property
    def begin(self) -> int:
        """The first instruction."""
        return self.accesses[0].line

    @property
    def end(self) -> int:
        """The last instruction."""
        return self.accesses[-1].line


def with_ordered_stack(lines: Sequence[str]) -> Sequence[str]:
    """A function without jumps whose values on the stack have other places; the same lines if some are not known."""
    accesses = _stack_accesses(lines)
    clusters = None if not accesses else _clusters(accesses)
    sizes = [int(match[2]) for line in lines if "%rsp" in line and (match := _FRAME_SIZE.search(line))]
    if not accesses or clusters is None or len(sizes) != 2 or len(set(sizes)) != 1:
        return lines
    short = [cluster for cluster in clusters if cluster.end - cluster.begin <= LONG_LIVED]
    long = [cluster for cluster in clusters if cluster.end - cluster.begin > LONG_LIVED]
    places, size = _placed(short, 0)
    more, size = _placed(long, size)
    top = max(access.distance + access.size for access in accesses) // PAIR * PAIR
    bottom = top - -(-size // PAIR) * PAIR
    growth = -((bottom - min(access.distance for access in accesses)) // PAIR) * PAIR
    changed = list(lines)
    for cluster, place in zip([*short, *long], [*places, *more], strict=True):
        for access in cluster.accesses:
            distance = bottom + place + access.distance - cluster.low
            changed[access.line] = _FRAME_OPERAND.sub(f"{distance}(%rbp)", lines[access.line])
    for number, line in enumerate(lines):
        if "%rsp" in line:
            changed[number] = _FRAME_SIZE.sub(lambda match: f"{match[1]}\t${int(match[2]) + growth}, %rsp", line)
    return changed


class OrderedConstants:
    """Constants of functions, in the order of their first uses, with those that are used again much later."""

    def __init__(self, lines: Sequence[str]) -> None:
        """Read the constants of an assembly file."""
        self._entries = _entries(lines)
        self._size = self._count = 0
        self._data: list[str] = []

    def ordered(self, lines: Sequence[str]) -> Sequence[str]:
        """A function that accesses its constants where they are in order; the same lines if some are not known."""
        found = {
            number: (match[1], int(match[2] or 0), size)
            for number, line in enumerate(lines)
            if "(%rip)" in line
            and (match := _CONSTANT_OPERAND.search(line))
            and (size := _size(line)) is not None
            and self._directives(match[1], int(match[2] or 0), size)
        }
        changed = list(lines)
        latest: dict[tuple[str, int, int], tuple[int, str]] = {}  # of each constant, when it was used, and its label
        for count, (number, constant) in enumerate(found.items()):
            before, label = latest.get(constant, (-AGAIN, ""))
            if count - before >= AGAIN:
                label = self._stored(*constant)
            latest[constant] = count, label
            changed[number] = _CONSTANT_OPERAND.sub(f"{label}(%rip)", lines[number])
        return changed

    def lines(self) -> Sequence[str]:
        """The section that contains them."""
        return [f'\t.section\t{SECTION},"a",@progbits', "\t.p2align\t5", *self._data] if self._data else []

    def _directives(self, label: str, start: int, size: int) -> Sequence[str]:
        """The lines that define so many bytes of a constant; none if they are not known."""
        position, found = 0, []
        for width, directive in self._entries.get(label, ()):
            if start <= position and position + width <= start + size:
                found.append((width, directive))
            position += width
        return [directive for _, directive in found] if sum(width for width, _ in found) == size else []

    def _stored(self, label: str, start: int, size: int) -> str:
        """The label of another copy of a constant."""
        if gap := -self._size % size:
            self._data.append(f"\t.zero\t{gap}")
        name = f".LCPIO_{self._count}"
        self._data += [f"{name}:", *self._directives(label, start, size)]
        self._size, self._count = self._size + gap + size, self._count + 1
        return name


def _size(line: str) -> int | None:
    """How many bytes an instruction accesses, if it is known."""
    name, _, operands = line.partition("#")[0].strip().partition("\t")
    if "%zmm" in operands or "{%k" in operands:  # eight numbers, or some of them
        return None
    if "{1to" in operands:  # one for all lanes
        return CELL
    return _size_of(name, "%ymm" in operands)


@functools.cache
def _size_of(name: str, is_of_four: bool) -> int | None:
    """The bytes that an instruction accesses, of one whose vectors have four numbers or of another."""
    if name in _HALVES:
        return None if is_of_four else 8
    if name in _PAIRS:
        return 16
    if name == "movq" or _SINGLE.fullmatch(name):
        return 8
    return (32 if is_of_four else 16) if _WIDE.fullmatch(name) else None


def _stack_accesses(lines: Sequence[str]) -> list[_Access] | None:
    """All accesses to the stack, but those to arguments; None if there are others, or the stack pointer moves."""
    found = []
    for number, line in enumerate(lines):
        if "%rsp" not in line and "%rbp" not in line:
            continue
        code = line.partition("#")[0].strip()
        if code in _FRAME or _FRAME_SIZE.fullmatch(code):
            continue
        match, size = _FRAME_OPERAND.search(code), _size(code)
        if match is None or size is None or int(match[1] or 0) % CELL:
            return None
        distance = int(match[1] or 0)
        if distance < 0:
            is_store = code.endswith("(%rbp)")
            if is_store and not _STORES.match(code):
                return None
            found.append(_Access(number, distance, size, is_store))
    return found


def _clusters(accesses: Sequence[_Access]) -> list[_Cluster] | None:
    """Accesses that must stay together, by their first instructions; None if a load is of what was not stored."""
    leaders: list[int] = []  # of each access, one of the same cluster that comes first
    holder: dict[int, int] = {}  # of each cell, the store whose number it holds

    def leader(access: int) -> int:
        while leaders[access] != access:
            access = leaders[access]
        return access

    for number, access in enumerate(accesses):
        cells = range(access.distance // CELL, (access.distance + access.size) // CELL)
        leaders.append(number)
        if access.is_store:
            holder.update(dict.fromkeys(cells, number))
            continue
        if any(cell not in holder for cell in cells):
            return None
        together = [leader(holder[cell]) for cell in cells]
        for other in (number, *together):
            leaders[other] = min(together)
    members: dict[int, list[_Access]] = {}
    for number, access in enumerate(accesses):
        members.setdefault(leader(number), []).append(access)
    return [
        _Cluster(min(each.distance for each in group), max(each.distance + each.size for each in group), group)
        for group in members.values()
    ]


def _placed(clusters: Sequence[_Cluster], start: int) -> tuple[list[int], int]:
    """Places from a start on, of which each is shared by clusters one after the other, and the end of all of them."""
    first = -(-start // PAIR) * PAIR
    busy = bytearray()  # of each cell
    ends: list[tuple[int, int, int]] = []  # the last instruction of a cluster, and its cells
    places = []
    for cluster in clusters:
        while ends and ends[0][0] < cluster.begin:
            _, low, high = heapq.heappop(ends)
            busy[low:high] = bytes(high - low)
        # A cluster that begins within a pair keeps its place there, as some of its accesses may be aligned.
        offset = cluster.low % PAIR // CELL if cluster.high - cluster.low > CELL else 0
        low = next(_gaps(busy, (cluster.high - cluster.low) // CELL, offset))
        high = low + (cluster.high - cluster.low) // CELL
        busy.extend(bytes(max(high - len(busy), 0)))
        busy[low:high] = b"\1" * (high - low)
        heapq.heappush(ends, (cluster.end, low, high))
        places.append(first + low * CELL)
    return places, first + len(busy) * CELL


def _gaps(busy: bytearray, length: int, offset: int) -> Iterator[int]:
    """Where so many cells are free: at any place if it is one, otherwise so many cells after a multiple of a pair."""
    step = 1 if length == 1 else PAIR // CELL
    wanted, place = bytes(length), 0
    cells = busy + bytes(length + PAIR // CELL)
    while (place := cells.find(wanted, place)) >= 0:
        if (place - offset) % step == 0:
            yield place
        place += 1


def _entries(lines: Sequence[str]) -> Mapping[str, Entries]:
    """The definitions of constants that consist of numbers alone."""
    found: dict[str, list[tuple[int, str]]] = {}
    label = ""
    for line in lines:
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0].startswith(".LCPI") and words[0].endswith(":"):
            label = words[0][:-1]
            found[label] = []
        elif label and words[0] in SIZES:
            found[label].append((SIZES[words[0]], line))
        elif label and words[0] == ".zero":
            found[label].append((int(words[1].partition(",")[0]), line))
        else:
            label = ""
    return found
