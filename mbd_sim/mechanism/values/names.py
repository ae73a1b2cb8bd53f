"""Names of the objects of a mechanism, which are those of its file: any text of one line, such as `shoulder-pitch`.

Where other signs could be meant, a name stands in quotes: in expressions, `'shoulder-pitch'.velocity`, in keys,
`joints.'left.knee'.damping`, and in lists of names. Parameters, functions and tables have plain names.
"""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Callable, Iterable

from mbd_sim.base.errors import InputError

# No control characters and line ends, no braces, which stand for indices, and no blanks at the ends.
_FORBIDDEN = r"\x00-\x1f\x7f-\x9f\u2028\u2029{}"
NAME_PATTERN = rf"^[^\s{_FORBIDDEN}](?:[^{_FORBIDDEN}]*[^\s{_FORBIDDEN}])?$"
# Those of parts and sensors are names of frames in TF as well, which must not begin with a slash.
FRAME_PATTERN = NAME_PATTERN.replace(r"^[^\s", r"^[^/\s")
PLAIN_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"
LONGEST_NAME = 200

QUOTED = r"""(?:'(?:[^'\\]|\\['"\\])*'|"(?:[^"\\]|\\['"\\])*")"""
_STEP = re.compile(rf"\.?(?:({QUOTED})|([^.\[\]'\"][^.\[\]]*))|\[(\d+)\]")
_QUOTED_PART = re.compile(rf"\s*({QUOTED})\s*(?:\.(.*))?")


def is_name(text: str) -> bool:
    """Whether a text can be the name of a part, joint or other object of a mechanism."""
    return bool(re.fullmatch(NAME_PATTERN, text)) and len(text) <= LONGEST_NAME


def accepted_names(written: Iterable[str], otherwise: str, valid: Callable[[str], bool] = is_name) -> dict[str, str]:
    """A unique name for each name of a file: its own wherever that is valid."""
    written = list(dict.fromkeys(written))
    found = {name: name for name in written if valid(name)}
    used = set(found)
    for name in written:
        if name not in found:
            plain = re.sub(f"[{_FORBIDDEN}]+", "_", name)[: LONGEST_NAME - len(otherwise) - 1].strip().lstrip("/ ")
            plain = plain if valid(plain) else f"{otherwise}_{plain}".rstrip("_")
            found[name] = unique_name(plain, used)
            used.add(found[name])
    return {name: found[name] for name in written}


def unique_name(wanted: str, used: Iterable[str]) -> str:
    """The wanted name, cut to the maximum length, with a number appended if another object has it."""
    used, number, name = set(used), 1, wanted[:LONGEST_NAME].strip()
    while name in used:
        number += 1
        ending = f"_{number}"
        name = wanted[: LONGEST_NAME - len(ending)] + ending
    return name


def in_quotes(name: str) -> str:
    """A name as it is written between other signs."""
    return "'" + name.replace("\\", r"\\").replace("'", r"\'") + "'"


def in_expression(name: str) -> str:
    """A name as it is written in an expression: in quotes, unless it is plain words."""
    plain = all(re.fullmatch(PLAIN_PATTERN, word) and not keyword.iskeyword(word) for word in name.split("."))
    return name if plain else in_quotes(name)


def unquoted(text: str) -> str:
    """A name without the quotes around it, if it has any."""
    return str(ast.literal_eval(text)) if re.fullmatch(QUOTED, text) else text


def split_names(text: str) -> list[str]:
    """The names in a list with commas; a name with commas stands in quotes."""
    return [unquoted(word) for word in split_words(text, ",") if word]


def split_assignment(text: str) -> tuple[str, str]:
    """The name, or the key, and the value of `name=value`; the value is "" where there is none."""
    name, *values = split_words(text, "=")
    return unquoted(name), text[text.index(name) + len(name) :].partition("=")[2].strip() if values else ""


def split_words(text: str, separator: str) -> list[str]:
    """The words between separators that are not in quotes."""
    words, start = [], 0
    for found in re.finditer(rf"(?:^|(?<=[.{separator}]))\s*{QUOTED}|({separator})", text):
        if found[1]:
            words.append(text[start : found.start()])
            start = found.end()
    return [word.strip() for word in (*words, text[start:])]


def split_key(key: str) -> list[str | int]:
    """The names and indices of a key such as `parts.rod.shapes[0].radius`.

    :raises InputError: it is not of this form.
    """
    steps: list[str | int] = []
    position = 0
    while position < len(key):
        step = _STEP.match(key, position)
        if step is None or (position == 0 and step[3]):
            raise InputError("is not a key of a mechanism file", "Write for example joints.elbow.damping.")
        steps.append(int(step[3]) if step[3] else unquoted(step[1]) if step[1] else step[2])
        position = step.end()
    return steps


def reference(part: str, point: str = "") -> str:
    """The reference `part` or `part.point`; the name of the part stands in quotes where another dot could end it."""
    part = in_quotes(part) if "." in part + point or part[0] in "'\"" else part
    return f"{part}.{point}" if point else part


def readings(text: str) -> list[tuple[str, str | None]]:
    """What a reference may mean: a part, and the name of a point of it, or None without a dot."""
    if found := _QUOTED_PART.fullmatch(text):
        return [(unquoted(found[1]), None if found[2] is None else found[2].strip())]
    dots = [place for place, letter in enumerate(text) if letter == "."]
    return [(text.strip(), None), *((text[:place].strip(), text[place + 1 :].strip()) for place in dots)]
