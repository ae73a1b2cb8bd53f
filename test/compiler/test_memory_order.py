"""Other places on the stack and for constants: each instruction accesses the same numbers."""

import re
from itertools import pairwise

import numpy as np
import pytest

from mbd_sim.compiler.memory_order import SECTION, OrderedConstants, with_ordered_stack

FRAME = ["\tpushq\t%rbp", "\tmovq\t%rsp, %rbp", "\tpushq\t%rbx", "\tsubq\t$1016, %rsp"]
END = ["\taddq\t$1016, %rsp", "\tpopq\t%rbx", "\tpopq\t%rbp", "\tretq"]
STORES = {"vmovsd\t%xmm1, {}": 8, "vmovapd\t%xmm2, {}": 16, "vmovupd\t%ymm3, {}": 32, "vmovhpd\t%xmm1, {}": 8}
LOADS = {"vmulsd\t{}, %xmm1, %xmm2": 8, "vfmadd231pd\t{}, %xmm3, %xmm4": 16, "vmovupd\t{}, %ymm5": 32}
LOADS |= {"vaddpd\t{}{{1to4}}, %ymm3, %ymm4": 8}
LOADS |= {"vmovddup\t{}, %xmm6": 8, "vmulpd\t{}, %xmm3, %xmm4": 16, "vunpcklpd\t{}, %xmm3, %xmm4": 16}
FIXED = 24  # bytes below the frame pointer, of which 16 hold the saved register and a gap


def random_function(count, seed=1):
    """Stores and loads of 8, 16 and 32 bytes that overlap, of numbers that were stored before."""
    rng = np.random.default_rng(seed)
    body, stored = [], set()
    kinds = [*STORES.items(), *LOADS.items()]
    while len(body) < count:
        form, size = kinds[rng.integers(len(kinds))]
        place = -16 - 16 * int(rng.integers(1, 60)) + (8 * int(rng.integers(2)) if size == 8 else 0)
        cells = set(range(place, place + size, 8))
        if place + size > -FIXED or (form in LOADS and not cells <= stored):
            continue
        if form in STORES:
            stored |= cells
        body.append("\t" + form.format(f"{place}(%rbp)"))
    return [*FRAME, *body, *END]


def executed(lines):
    """What each load reads: of each cell, the line that stored it and the place within what it stored."""
    memory, read = {}, []
    bottom = -8 - next(int(line.split("$")[1].split(",")[0]) for line in lines if "subq" in line)
    for number, line in enumerate(lines):
        match = re.search(r"(-?\d+)\(%rbp\)", line)
        if match is None:
            continue
        form = line.strip().replace("{1to4}", "{{1to4}}").replace(match[0], "{}")
        size = STORES.get(form) or LOADS[form]
        place = int(match[1])
        assert bottom <= place <= -FIXED - size
        assert size < 16 or place % 16 == 0
        for index, cell in enumerate(range(place, place + size, 8)):
            if form in STORES:
                memory[cell] = number, index
            else:
                read.append((number, index, memory[cell]))
    return read


def test_each_load_reads_what_it_read_before():
    lines = random_function(2500)
    after = with_ordered_stack(lines)
    assert executed(after) == executed(lines)
    assert after != lines


def test_values_that_are_used_one_after_the_other_become_neighbours():
    places = -16 * np.random.default_rng(2).permutation(np.arange(3, 60))
    body = [
        line
        for place in places
        for line in (f"\tvmovapd\t%xmm0, {place}(%rbp)", f"\tvaddpd\t{place}(%rbp), %xmm1, %xmm0")
    ]
    after = with_ordered_stack([*FRAME, *body, *END])
    assert after[-len(END)] == f"\taddq\t${1016 - 16 * (len(places) - 1)}, %rsp"
    assert len({re.search(r"-\d+", line)[0] for line in after if "(%rbp)" in line}) == 1


def test_more_room_is_taken_where_it_is_needed():
    body = ["\tvmovapd\t%xmm0, -1024(%rbp)", "\tvmovsd\t%xmm0, -1008(%rbp)", "\tvmovupd\t-1024(%rbp), %ymm1"]
    body[2:2] = ["\tvmovsd\t%xmm0, -1000(%rbp)", *["\tvaddpd\t%xmm0, %xmm0, %xmm0"] * 2100]
    body += ["\tvmovapd\t%xmm0, -1024(%rbp)", "\tvmovapd\t-1024(%rbp), %xmm0"]
    after = with_ordered_stack([*FRAME, *body, *END])
    assert after[3] == "\tsubq\t$1032, %rsp"
    assert after[-len(END)] == "\taddq\t$1032, %rsp"
    assert after[4] != after[-len(END) - 2].replace("%xmm0, ", "")


@pytest.mark.parametrize(
    "line",
    [
        "\tleaq\t-64(%rbp), %rax",
        "\tmovq\t%rbp, %rax",
        "\tmovl\t-64(%rbp), %eax",
        "\taddq\t$8, -64(%rbp)",
        "\tvmovapd\t-64(%rbp,%rax), %xmm0",
        "\tvmovapd\t(%rsp), %xmm0",
        "\tsubq\t$16, %rsp",
        "\tvaddpd\t-512(%rbp), %xmm0, %xmm0",
        "\tvcvtsi2sdq\t-64(%rbp), %xmm0, %xmm0",
        "\tvaddpd\t-64(%rbp), %zmm0, %zmm0",
        "\tvmovapd\t-64(%rbp), %xmm0 {%k1} {z}",
    ],
)
def test_functions_with_other_accesses_stay_as_they_are(line):
    """Addresses, parts of numbers, other operations, another frame, what was not stored, eight numbers, and masks."""
    body = ["\tvmovapd\t%xmm0, -64(%rbp)", "\tvmovapd\t%xmm0, -800(%rbp)", line]
    lines = [*FRAME, *body, *END]
    assert with_ordered_stack(lines) is lines
    assert with_ordered_stack([*FRAME, *body[:2], *END]) != [*FRAME, *body[:2], *END]


def constants(count):
    """The section of constants of two numbers, of which the second is larger by 1000."""
    pairs = [[f".LCPI0_{n}:", f"\t.quad\t{n}    # a comment", f"\t.quad\t{n + 1000}"] for n in range(count)]
    return [
        '\t.section\t.rodata.cst16,"aM",@progbits,16',
        "\t.p2align\t4, 0x0",
        *(line for pair in pairs for line in pair),
    ]


def test_constants_are_those_of_before_in_the_order_of_their_uses():
    rng = np.random.default_rng(3)
    used = rng.integers(0, 50, 300).tolist()
    forms = {
        "\tvaddpd\t.LCPI0_{}(%rip), %xmm1, %xmm1": (0, 1000),
        "\tvmovsd\t.LCPI0_{}(%rip), %xmm1": (0,),
        "\tvmovddup\t.LCPI0_{}+8(%rip), %xmm1": (1000,),
    }
    kinds = [list(forms)[n] for n in rng.integers(0, 3, 300)]
    ordered = OrderedConstants(constants(50))
    after = ordered.ordered([form.format(n) for form, n in zip(kinds, used, strict=True)])
    section = ordered.lines()
    assert section[0] == f'\t.section\t{SECTION},"a",@progbits'
    labels, memory = {}, []
    for line in section[2:]:
        name, _, value = line.partition("#")[0].strip().partition("\t")
        if name.endswith(":"):
            labels[name[:-1]] = len(memory)
        else:
            memory.append(None if name == ".zero" else int(value))
    found = [labels[re.search(r"(\.LCPI\w+)\(%rip\)", line)[1]] for line in after]
    for place, form, number in zip(found, kinds, used, strict=True):
        assert memory[place : place + len(forms[form])] == [number + more for more in forms[form]]
        assert len(forms[form]) == 1 or place % 2 == 0
    assert max(before - place for before, place in pairwise(found)) < 2 * 50  # nothing far back
    assert len(memory) < 2 * len(used)


def test_constants_that_are_not_known_stay_where_they_are():
    lines = ["\tvaddpd\t.LCPI0_1(%rip), %xmm1, %xmm1", "\tvaddsd\t.LCPI0_7(%rip), %xmm1, %xmm1"]
    lines += ["\tvpand\t.LCPI0_0(%rip), %xmm1, %xmm1", "\tvaddpd\t.LCPI0_1+8(%rip), %xmm1, %xmm1"]
    ordered = OrderedConstants([*constants(2)[:5], ".LCPI0_1:", "\t.octa\t1"])
    assert ordered.ordered(lines) == lines
    assert not ordered.lines()
