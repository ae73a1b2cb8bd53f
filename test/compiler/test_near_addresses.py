"""Shorter addresses: the same results from less code, and registers that hold nothing else."""

import ctypes
import platform
import re

import casadi as ca
import numpy as np
import pytest

from mbd_sim.compiler import machine_code, object_code
from mbd_sim.compiler.host_module import new_module
from mbd_sim.compiler.lowering import export, lower
from mbd_sim.compiler.near_addresses import REACH, with_near_addresses

CALL, SLOT = "\tcallq\tother", "\tvmovsd\t-800(%rbp), %xmm0"
CONSTANTS = [
    '\t.section\t.rodata.cst8,"aM",@progbits,8',
    "\t.p2align\t3, 0x0",
    *(line for number in range(20) for line in (f".LCPI0_{number}:", f"\t.quad\t{number}")),
    ".LCPI0_20:",
    "\t.zero\t16,255",  # bytes of ones
]


FRAME = ["\tpushq\t%rbp", "\tmovq\t%rsp, %rbp"]


def shortened(body, before=(), frame=FRAME):
    """The lines of a function after the pass, between those that set its frame pointer and those that restore it."""
    return shortened_with_constants(body, before, frame)[0]


def shortened_with_constants(body, before=(), frame=FRAME):
    """The lines of a function after the pass, and of the constants that it accesses the labels and the numbers."""
    end = ["\tpopq\t%rbp", "\tretq", ".Lfunc_end0:", "\t.size\trates, .Lfunc_end0-rates"]
    text = "\n".join([*before, "\t.text", "rates:", *frame, *body, *end])
    assert with_near_addresses(text, ()) == text + "\n"
    lines = with_near_addresses(text, {"rates"}).splitlines()
    first = lines.index("rates:") + 1
    assert lines[first : first + len(frame)] == frame
    constants = lines[lines.index(end[-1]) + 3 :]
    return lines[first + len(frame) : lines.index("\tpopq\t%rbp")], (
        [label.removesuffix(":") for label in constants[::2]],
        [int(line.removeprefix("\t.quad\t")) for line in constants[1::2]],
    )


def pointers(lines):
    """The registers that are made to point somewhere."""
    return {match[1] for line in lines if (match := re.match(r"\tleaq\t-?\d+\(%rbp\), %(\w+)", line))}


def accessed(lines, labels=(), numbers=()):
    """What instructions access: distances from the frame pointer, or constants."""
    registers, found = {}, []
    for line in lines:
        if match := re.match(r"\tleaq\t(-?\d+)\(%rbp\), %(\w+)", line):
            registers[match[2]] = int(match[1])
        elif match := re.match(r"\tleaq\t(\.LCPI\w+)\+0([-+]\d+)\(%rip\), %(\w+)", line):
            registers[match[3]] = 8j * labels.index(match[1]) + int(match[2]) * 1j
        elif match := re.search(r"(-?\d+)\(%(r(?!ip)\w+)\)", line):
            distance = int(match[1])
            assert match[2] == "rbp" or -REACH <= distance < REACH
            pointer = 0 if match[2] == "rbp" else registers[match[2]]
            if isinstance(pointer, complex):
                found.append(f"number {numbers[int(pointer.imag + distance) // 8]}")
            else:
                found.append(pointer + distance)
        elif match := re.search(r"(\.LCPI\w+)\(%rip\)", line):
            found.append(f"number {numbers[labels.index(match[1])]}")
        if "call" in line:
            registers.clear()
    return found


def test_each_instruction_accesses_the_same_place():
    rng = np.random.default_rng(1)
    places = (-8 * rng.integers(1, 600, 900)).tolist()
    body = [f"\tvmulpd\t{place}(%rbp), %xmm1, %xmm2" for place in places]
    for number in range(0, 900, 7):
        body[number] = f"\tvaddsd\t.LCPI0_{number % 20}(%rip), %xmm1, %xmm1"
    body[500:500], body[50:50] = [CALL], [CALL]
    after, constants = shortened_with_constants(body, CONSTANTS)
    assert accessed(after, *constants) == accessed(body, [f".LCPI0_{number}" for number in range(20)], range(20))
    assert sum("(%rbp)" in line or "(%rip)" in line for line in after) < 0.7 * len(body)
    assert [line for line in after if "leaq" not in line and "(%r" not in line] == [CALL, CALL]


def test_registers_that_hold_something_are_left_alone():
    body = ["\tvmovsd\t(%rsi), %xmm3", "\tmovl\t$1, %r10d", *[SLOT] * 60, "\tmovq\t%rbx, %rdi", *[SLOT] * 60, CALL]
    body += [*[SLOT] * 60, "\tmovb\t%cl, %al", *[SLOT] * 60, "\taddl\t%edx, %r9d"]
    after = shortened(body)
    assert not pointers(after[: after.index(CALL)])  # all of them may be arguments of the call
    following = after[after.index(CALL) + 1 :]
    moved = following.index("\tmovb\t%cl, %al")
    assert pointers(following[:moved]) == {"rsi"}
    assert not pointers(following) & {"rdx", "r9"}
    assert sum("(%rsi), %xmm0" in line for line in following) == 120


@pytest.mark.parametrize("line", [".LBB0_1:", "\tjne\t.LBB0_1", "\trep;movsq", "\tidivq\t%rcx"])
def test_functions_with_jumps_or_other_instructions_stay_as_they_are(line):
    body = [*[SLOT] * 200, line]
    assert shortened(body) == body
    assert shortened(body[:-1]) != body[:-1]


@pytest.mark.parametrize(
    ("frame", "line"),
    [
        (["\tpushq\t%rbp"], "\tmovq\t%rdi, %rbp"),
        (["\tpushq\t%rbp", "\tleaq\t296(%rsp), %rbp"], "\tvzeroupper"),
        (FRAME, "\taddq\t$64, %rbp"),
        (FRAME, "\tmovl\t%ecx, %ebp"),
    ],
)
def test_functions_without_a_frame_pointer_stay_as_they_are(frame, line):
    """They may use its register for something else, which moves."""
    body = [*[SLOT] * 100, line, *[SLOT] * 100]
    assert shortened(body, frame=frame) == body
    assert shortened([*[SLOT] * 200, "\tvzeroupper"]) != [*[SLOT] * 200, "\tvzeroupper"]


def test_constants_whose_places_are_not_known_stay_as_they_are():
    body = ["\tvaddsd\t.LCPI0_3(%rip), %xmm1, %xmm1"] * 200
    assert shortened(body, CONSTANTS) != body
    assert shortened(body, [line.replace(".quad", ".octa") for line in CONSTANTS]) == body


def products(numbers):
    """A function with twice as many products as there are numbers, and sines that are called."""
    x = ca.SX.sym("x", numbers.shape[1])
    return ca.Function("rates", [x], [(ca.DM(numbers) @ ca.sin(x)) * (ca.DM(numbers) @ x)])


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the pass is for x86-64")
def test_shorter_code_has_the_same_bits(monkeypatch):
    monkeypatch.setattr(machine_code, "LEVEL", 1)
    rng = np.random.default_rng(2)
    numbers, given = rng.normal(size=(16, 20)), rng.normal(size=20)
    module = new_module()
    export(module, "call", lower(module, products(numbers), inline=False))
    text, results, sizes = str(module), [], []
    for lines in (10**6, 1000):
        monkeypatch.setattr(object_code, "NEAR_ADDRESSES", lines)
        code = object_code.object_code(text, *machine_code.host(), 1)
        loaded, out = machine_code.linked({str(lines): code}), np.empty(16)
        ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("call"))(
            given.ctypes.data, out.ctypes.data
        )
        results.append(out)
        sizes.append(len(code))
    assert results[0].tobytes() == results[1].tobytes()
    assert sizes[1] < 0.95 * sizes[0]
    np.testing.assert_allclose(results[1], (numbers @ np.sin(given)) * (numbers @ given), rtol=1e-12)
