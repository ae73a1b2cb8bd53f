"""YAML of words and numbers, laid out as PyYAML does it, in a fifth of its time.

That is most of the text of a robot. Other text, which may have to be quoted or folded, is left to PyYAML.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from mbd_sim.mechanism.source import Location

INDENT = 2
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]{0,99}")
_COLOR = re.compile(r"#[0-9A-Za-z]{1,20}")
_URI = re.compile(r"[a-z]+://[A-Za-z0-9_./-]{1,99}")


class UnusualTextError(Exception):
    """A text that is neither a word nor a number."""


class YamlLayout:
    """The text of a mapping, written line by line.

    :param width: the column from which on lists and mappings in brackets continue in the next line.
    :param is_block: whether the entries of the mapping or list at a location are on lines of their own.
    :param number: the text of a number, true, false or null.
    :param is_quoted: whether a word without quotes would be read as something else.
    """

    def __init__(
        self,
        width: int,
        is_block: Callable[[Location], bool],
        number: Callable[[Any], str],
        is_quoted: Callable[[str], bool],
    ) -> None:
        self._width, self._is_block, self._number, self._is_quoted = width, is_block, number, is_quoted
        self._parts: list[str] = []
        self._column = 0

    def text(self, data: dict[str, Any]) -> str:
        """The text of the data.

        :raises UnusualTextError: it has strings that may have to be quoted or folded.
        """
        if not _given(data):
            raise UnusualTextError
        self._mapping(data, (), 0)
        return "".join(self._parts)

    def _mapping(self, data: dict[str, Any], location: Location, indent: int) -> None:
        """A mapping with an entry per line."""
        for key, value in _given(data).items():
            self._write(f"{' ' * indent}{self._string(key, in_brackets=False)}:")
            inner = (*location, key)
            if not isinstance(value, dict | list | tuple) or not self._is_block(inner) or not _given(value):
                self._write(" ")
                self._flow(value, indent)
                self._end_line()
            elif isinstance(value, dict):
                self._end_line()
                self._mapping(value, inner, indent + INDENT)
            else:
                self._end_line()
                self._sequence(value, inner, indent)

    def _sequence(self, values: list[Any] | tuple[Any, ...], location: Location, indent: int) -> None:
        """A list with an entry per line, below the key to which it belongs."""
        for index, value in enumerate(values):
            if isinstance(value, dict | list | tuple) and self._is_block((*location, index)):
                raise UnusualTextError
            self._write(f"{' ' * indent}- ")
            self._flow(value, indent)
            self._end_line()

    def _flow(self, value: Any, indent: int, *, in_brackets: bool = False) -> None:
        """A scalar, or what is in brackets."""
        if not isinstance(value, dict | list | tuple):
            self._write(self._string(value, in_brackets=in_brackets) if isinstance(value, str) else self._number(value))
            return
        opening, closing = "{}" if isinstance(value, dict) else "[]"
        self._write(opening)
        indent += INDENT
        given = _given(value)
        for number, entry in enumerate(given):
            if number:
                self._write(",")
            if self._column > self._width:
                self._end_line()
                self._write(" " * indent)
            elif number:
                self._write(" ")
            if isinstance(given, dict):
                self._write(f"{self._string(entry, in_brackets=True)}: ")
                self._flow(given[entry], indent, in_brackets=True)
            else:
                self._flow(entry, indent, in_brackets=True)
        self._write(closing)

    def _string(self, text: str, *, in_brackets: bool) -> str:
        if _WORD.fullmatch(text):
            return f'"{text}"' if self._is_quoted(text) else text
        if _URI.fullmatch(text):
            return f"'{text}'" if in_brackets else text
        if _COLOR.fullmatch(text):
            return f"'{text}'"
        raise UnusualTextError

    def _write(self, text: str) -> None:
        self._parts.append(text)
        self._column += len(text)

    def _end_line(self) -> None:
        self._parts.append("\n")
        self._column = 0


def _given(value: Any) -> Any:
    """A list, or a mapping without the keys that have no value."""
    if not isinstance(value, dict):
        return value
    return {str(key): inner for key, inner in value.items() if inner is not None}
