"""What errors print: nothing that a terminal would obey."""

import ast
import pickle
import re
from pathlib import Path

import pytest

import mbd_sim
from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError, InputError, MechanismError, Problem, counted, printable, require_each_once
from mbd_sim.files.load import parse_mechanism

BODY = "joints: {j: {type: revolute, between: [ground, a], axis: [0, 0, 1]}}\n"


def test_control_characters_and_directional_overrides_are_escaped():
    assert printable("a\x1b[31m\u202eb\x9b\u2066\ufeff") == "a\\x1b[31m\\u202eb\\x9b\\u2066\\ufeff"
    assert printable("m/s², 30°, 漢字 – × ·") == "m/s², 30°, 漢字 – × ·"
    assert printable("a\nb\r", keep="\n") == "a\nb\\r"


@pytest.mark.parametrize(
    "error", [InputError("a\x1b[31m"), CommandError("a\x1b[31m"), MechanismError([Problem("a\x1b[31m")])]
)
def test_every_error_prints_control_characters_escaped(error):
    assert "a\\x1b[31m" in str(error) and "\x1b" not in str(error)


@pytest.mark.parametrize(
    "text",
    [
        'parts: {a: {mass: 1, "x\\e[31m\\n": 1}}\n' + BODY,
        'parts: {a: {mass: 1}, "\\e]0;owned\\a": {mass: 1}}\n' + BODY,
        'parts: {a: {mass: "l\\u202e"}}\n' + BODY,
        'parts: {a: {mass: 1, shapes: [{type: "\\e[2J"}]}}\n' + BODY,
        'parts: {a: {mass: 1}}\njoints: {j: {type: fixed, between: [ground, "a.\\e[31m"]}}\n',
        'parameters: {"\\e[31m": 1, "\\u202e": q}\nparts: {a: {mass: 1}}\n' + BODY,
    ],
)
def test_names_of_a_file_are_printed_escaped(text):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism("mechanism: x\n" + text, "\x1b[31mfile.yaml")
    assert str(caught.value).replace("\n", "").isprintable()
    assert all(line.startswith("\\x1b[31mfile.yaml:") for line in str(caught.value).splitlines())


@pytest.mark.parametrize("command", ["set_efforts", "set_live"])
def test_names_in_commands_are_printed_escaped(command):
    sim = Simulation.from_file("rod_pendulum")
    with pytest.raises(CommandError) as caught:
        getattr(sim, command)({"\x1b[31mhinge": 1.0})
    assert str(caught.value).isprintable()


def test_counts_have_the_plural_except_of_one():
    assert [counted(number, "step") for number in (0, 1, 2)] == ["0 steps", "1 step", "2 steps"]


class CountedName(str):
    """A name that counts how often names are compared."""

    comparisons = 0
    __hash__ = str.__hash__

    def __eq__(self, other):
        CountedName.comparisons += 1
        return str.__eq__(self, other)


def test_names_of_a_command_are_compared_in_proportion_to_their_number():
    """Each with all others, 50,000 names would keep a node busy for 20 s."""
    names = [CountedName(number) for number in range(1000)]
    require_each_once(names, "")
    with pytest.raises(CommandError, match=r"^'7' is named twice\. Name each once\.$"):
        require_each_once([*names, CountedName(7), CountedName(5)], "Name each once.")
    assert 0 < CountedName.comparisons < 2 * len(names)


LONG = "x" * 200_000


@pytest.mark.parametrize(
    "text",
    [
        f'<robot name="r"><link name="{LONG}"/><link name="a"/></robot>',
        f'<robot name="r"><link name="a"><inertial><mass value="{"9" * 200_000}x"/></inertial></link></robot>',
        f'<robot name="r"><link name="a"/><joint name="{LONG}" type="{LONG}"><parent link="{LONG}"/></joint></robot>',
        f"mechanism: m\nparts: {{a: {{mass: 1}}}}\n? {LONG}\n: 1\n",
    ],
)
def test_long_names_do_not_make_long_messages(text):
    """A message of 200 kB for one wrong name; a number of so many digits took minutes."""
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(text)
    assert len(str(caught.value)) < 10_000


GLUED = re.compile(
    r"[.;] (use|give|choose|leave|change|set|write|restore|call|keep|make|build|request|lower)\b", re.IGNORECASE
)
OF_PYTHON = {"TypeError", "NotImplementedError", "OSError", "ImportError", "AttributeError", "ModuleNotFoundError"}


def test_remedies_are_not_part_of_messages():
    """Another text around the message, as that of a command or a file, would separate them."""
    glued = []
    for file in Path(mbd_sim.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                message = ast.unparse(node.exc.args[0])
                if ast.unparse(node.exc.func) not in OF_PYTHON and GLUED.search(message):
                    glued.append(f"{file}:{node.lineno}: {message}")
    assert not glued


def test_errors_return_from_other_processes():
    for error in (InputError("a", remedy="b", value=3), MechanismError([Problem("a", "b")])):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))
