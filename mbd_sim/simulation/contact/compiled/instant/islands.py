"""Islands of a contact problem: rows that no forces of other rows change, in the subset of Python that is compiled.

Bodies that are far from each other have nothing to do with each other. What is found of each island alone is also found
of all together, but in a time that grows with the cube of the number of rows.
"""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.compiler.rows.islands import number_islands, unite
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem, unique_together
from mbd_sim.simulation.contact.compiled.instant.linear import block_rows, take_block
from mbd_sim.simulation.contact.compiled.instant.shared_forces import settled_together

ROWS, NORMALS, FRICTIONS = 0, 1, 2  # of the sizes of an island
SIZES = 3


def find_islands(p: ForceProblem, islands: Integers) -> int:
    """The number of the island (n,) of each row, in the order of their first rows; how many there are."""
    for i in range(p.n):
        islands[i] = i
    for i in range(p.n):
        for j in range(p.n):
            if p.matrix[i * p.n + j] != 0.0:
                unite(p.n, islands, i, j)
    for k in range(p.frictions):
        if p.friction_rows[2 * k + 1] >= 0:
            unite(p.n, islands, p.friction_rows[2 * k], p.friction_rows[2 * k + 1])
        if p.loads[k] >= 0:
            unite(p.n, islands, p.friction_rows[2 * k], p.loads[k])
    return number_islands(p.n, islands)


def measure_island(p: ForceProblem, islands: Integers, island: int, sizes: Integers) -> None:
    """The numbers of rows, of normal rows and of friction elements of an island."""
    sizes[ROWS], sizes[NORMALS], sizes[FRICTIONS] = 0, 0, 0
    for i in range(p.n):
        sizes[ROWS] += 1 if islands[i] == island else 0
    for i in range(p.normals):
        sizes[NORMALS] += 1 if islands[p.normal_rows[i]] == island else 0
    for k in range(p.frictions):
        sizes[FRICTIONS] += 1 if islands[p.friction_rows[2 * k]] == island else 0


def take_island(p: ForceProblem, islands: Integers, island: int, own: ForceProblem, rows: Integers) -> None:
    """Write the problem of an island into the arrays of its `own` one; its `rows` are these of the whole."""
    place, count = integers(p.n), block_rows(p.n, islands, island, rows)
    take_block(p.n, p.matrix, count, rows, own.matrix)
    for i in range(count):
        place[rows[i]], own.free[i] = i, p.free[rows[i]]
    count = 0
    for i in range(p.normals):
        if islands[p.normal_rows[i]] == island:
            own.normal_rows[count] = place[p.normal_rows[i]]
            count += 1
    count = 0
    for k in range(p.frictions):
        first, second, load = p.friction_rows[2 * k], p.friction_rows[2 * k + 1], p.loads[k]
        if islands[first] == island:
            own.friction_rows[2 * count] = place[first]
            own.friction_rows[2 * count + 1] = -1 if second < 0 else place[second]
            own.loads[count], own.sizes[count] = -1 if load < 0 else place[load], p.sizes[k]
            count += 1


def unique_forces(p: ForceProblem, forces: Array) -> bool:
    """λ (n,) that satisfies all conditions, if it is found quickly and the only one."""
    islands = integers(p.n)
    count = find_islands(p, islands)
    if count < 2:
        return unique_together(p, forces)
    rigid = zeros(p.n)
    return not any(not forces_on(p, rigid, islands, island, False, forces) for island in range(count))


def settled_forces(p: ForceProblem, compliance: Array, forces: Array) -> bool:
    """λ (n,) that satisfies all conditions, of several those of least Σ C λ²; False where it is not found quickly."""
    islands = integers(p.n)
    count = find_islands(p, islands)
    if unique_forces(p, forces):
        return True
    return not any(not forces_on(p, compliance, islands, island, True, forces) for island in range(count))


def forces_on(
    p: ForceProblem, compliance: Array, islands: Integers, island: int, settled: bool, forces: Array
) -> bool:  # fmt: skip
    """The forces of an island, among those of all: those that are `settled`, or the only ones."""
    sizes = integers(SIZES)
    measure_island(p, islands, island, sizes)
    n, normals, frictions = sizes[ROWS], sizes[NORMALS], sizes[FRICTIONS]
    rows, found, supports, matrix = integers(n), zeros(n), zeros(n), zeros(n * n)
    free, limits = zeros(n), zeros(frictions)
    normal_rows, friction_rows, loads = integers(normals), integers(2 * frictions), integers(frictions)
    own = ForceProblem(n, matrix, free, normals, normal_rows, frictions, friction_rows, loads, limits)
    take_island(p, islands, island, own, rows)
    for i in range(n):
        supports[i] = compliance[rows[i]]
    if not (settled_together(own, supports, found) if settled else unique_together(own, found)):
        return False
    for i in range(n):
        forces[rows[i]] = found[i]
    return True
