"""Islands of rows that no forces of other rows change, in the subset of Python that is compiled."""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers

MANY = 100  # rows from which on islands, and what is not zero, are looked for: below, that takes longer than it saves


def find_islands(n: int, gaps: int, matrix: Array, closed: Array, active: Array, islands: Integers) -> int:
    """The number of the island (n,) of each row that is active or closed, -1 for others; how many islands there are.

    :param matrix: (n, n) column by column.
    :param closed: (gaps,) and `active` (n,) are not zero for these rows.
    """
    rows, count = integers(n), 0
    for i in range(n):
        is_closed = closed[i] != 0.0 if i < gaps else False
        islands[i] = -1
        if is_closed or active[i] != 0.0:
            rows[count], islands[i] = i, i
            count += 1
    for j in range(count):
        for i in range(count):
            if matrix[rows[i] + rows[j] * n] != 0.0:
                unite(n, islands, rows[i], rows[j])
    return number_islands(n, islands)


def unite(n: int, islands: Integers, i: int, j: int) -> None:
    """Let two rows belong to one island, which is named after its first row until islands are numbered."""
    lower, higher = min(islands[i], islands[j]), max(islands[i], islands[j])
    for k in range(n if lower < higher else 0):
        if islands[k] == higher:
            islands[k] = lower


def number_islands(n: int, islands: Integers) -> int:
    """Number islands from 0 on, in the order of their first rows; how many there are. Rows at -1 belong to none."""
    count, numbers = 0, integers(n)
    for i in range(n):
        if islands[i] == i:
            numbers[i] = count
            count += 1
    for i in range(n):
        if islands[i] >= 0:
            islands[i] = numbers[islands[i]]
    return count
