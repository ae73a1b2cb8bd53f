"""Elimination contact by contact, in the subset of Python that is compiled.

In a heap each contact acts on few others. They are eliminated in the order of least degree, each with those only that
it is coupled with by then; rows are exchanged within a contact alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers
from mbd_sim.simulation.contact.compiled.instant.forces import ForceProblem


@dataclass(frozen=True)
class Elimination:
    """The contacts of a problem in the order of their elimination; each has some `sizes` (contacts,) of own rows.

    Contact k is `coupled` with the rows from `begins` k on and before `begins` k + 1, of which its own come first, and
    then those of later contacts.
    """

    contacts: int
    sizes: Integers
    begins: Integers
    coupled: Integers


def number_contacts(p: ForceProblem, contacts: Integers) -> int:
    """The number of the contact (n,) of each row: a normal row and its friction, or other friction; how many."""
    count = p.normals
    for i in range(p.normals):
        contacts[p.normal_rows[i]] = i
    for k in range(p.frictions):
        number = count
        if p.loads[k] >= 0:
            number = contacts[p.loads[k]]
        else:
            count += 1
        for direction in range(2):
            if p.friction_rows[2 * k + direction] >= 0:
                contacts[p.friction_rows[2 * k + direction]] = number
    return count


def find_order(p: ForceProblem, contacts: Integers, count: int, e: Elimination) -> None:
    """Find the order in which so many contacts, of which each row belongs to one, are eliminated."""
    near, degrees, own = integers(count * count), integers(count), integers(count)
    for i in range(p.n):
        for j in range(p.n):
            if p.matrix[i * p.n + j] != 0.0:
                near[contacts[i] * count + contacts[j]] = 1
                near[contacts[j] * count + contacts[i]] = 1
    for k in range(count):
        near[k * count + k] = 0
        for other in range(count):
            degrees[k] += near[k * count + other]
    e.begins[0] = 0
    for position in range(count):
        chosen = -1
        for k in range(count):
            if degrees[k] >= 0 and (chosen < 0 or degrees[k] < degrees[chosen]):
                chosen = k
        e.begins[position + 1] = e.begins[position]
        add_rows(p.n, contacts, chosen, position, e)
        e.sizes[position] = e.begins[position + 1] - e.begins[position]
        eliminate_contact(count, near, degrees, chosen, own)
        for k in range(degrees[chosen]):
            add_rows(p.n, contacts, own[k], position, e)
        degrees[chosen] = -1


def add_rows(n: int, contacts: Integers, contact: int, position: int, e: Elimination) -> None:
    """Add the rows of a contact to those that the one at a position is coupled with."""
    for i in range(n):
        if contacts[i] == contact:
            e.coupled[e.begins[position + 1]] = i
            e.begins[position + 1] += 1


def eliminate_contact(count: int, near: Integers, degrees: Integers, chosen: int, own: Integers) -> None:
    """Write the contacts near the chosen one to `own`; these become near to each other, and it is near to none."""
    found = 0
    for k in range(count):
        if near[chosen * count + k]:
            own[found] = k
            found += 1
            near[chosen * count + k], near[k * count + chosen] = 0, 0
            degrees[k] -= 1
    for i in range(found):
        for j in range(found):
            if i != j and not near[own[i] * count + own[j]]:
                near[own[i] * count + own[j]] = 1
                degrees[own[i]] += 1


def eliminate(e: Elimination, n: int, a: Array, x: Array) -> float:
    """Solve a square system of which x is the right side, and `a` (n, n) the matrix, which changes.

    :return: the least pivot up to 1; if it is zero, there is no solution.
    """
    least = 1.0
    for k in range(e.contacts):
        rows, size = e.coupled[e.begins[k] :], e.begins[k + 1] - e.begins[k]
        for done in range(e.sizes[k]):
            exchange_rows(n, a, x, rows, size, done, e.sizes[k])
            base, column = a[rows[done] * n :], rows[done]
            if not abs(base[column]) > 0.0:
                return 0.0
            least = min(least, abs(base[column]))
            for i in range(done + 1, size):
                own = a[rows[i] * n :]
                factor = own[column] / base[column]
                if factor != 0.0:
                    for j in range(done + 1, size):
                        own[rows[j]] -= factor * base[rows[j]]
                    x[rows[i]] -= factor * x[column]
    for k in range(e.contacts - 1, -1, -1):
        rows, size = e.coupled[e.begins[k] :], e.begins[k + 1] - e.begins[k]
        for done in range(e.sizes[k] - 1, -1, -1):
            base, total = a[rows[done] * n :], x[rows[done]]
            for j in range(done + 1, size):
                total -= base[rows[j]] * x[rows[j]]
            x[rows[done]] = total / base[rows[done]]
    return least


def exchange_rows(n: int, a: Array, x: Array, rows: Integers, size: int, done: int, own: int) -> None:
    """Exchange a row with the one of the same contact that has the largest entry in its column."""
    pivot, column, first = done, rows[done], rows[done] * n
    for i in range(done + 1, own):
        if abs(a[rows[i] * n + column]) > abs(a[rows[pivot] * n + column]):
            pivot = i
    if pivot == done:
        return
    second = rows[pivot] * n
    for j in range(done, size):
        a[first + rows[j]], a[second + rows[j]] = a[second + rows[j]], a[first + rows[j]]
    x[column], x[rows[pivot]] = x[rows[pivot]], x[column]
