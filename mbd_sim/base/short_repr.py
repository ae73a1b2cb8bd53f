"""The `repr` of records and models: one short line that says what they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeVar, dataclass_transform

Kind = TypeVar("Kind")

LONGEST = 190  # characters of the whole
LONGEST_VALUE = 48  # of a value
OWNERS = ("mechanism", "model", "simulation")  # attributes that say what a model belongs to


def short_repr(self: object) -> str:
    """The fields of a record as far as they fit on a line; of other objects, the mechanism that they belong to.

    Assign it in the body of a class: `__repr__ = short_repr`.
    """
    name = type(self).__name__
    names = [one.name for one in fields(self)] if is_dataclass(self) else [*getattr(self, "_fields", ())]
    if not names:
        return f"<{name}{_owner(self)}>"
    shown, length = list[str](), len(name)
    for one in (one for one in names if not one.startswith("_")):
        text = f"{one}={short(getattr(self, one))}"
        length += len(text) + 2
        if length > LONGEST:
            shown.append("…")
            break
        shown.append(text)
    return f"{name}({', '.join(shown)})"


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def record(cls: type[Kind]) -> type[Kind]:
    """A frozen dataclass that is compared by identity, and shown by `short_repr`."""
    cls.__repr__ = short_repr  # type: ignore[method-assign]
    return dataclass(frozen=True, eq=False)(cls)


def short(value: object) -> str:
    """A value in a few characters: numbers with six digits, and the size of what is too long."""
    match value:
        case bool() | None | int():
            return repr(value)
        case float():
            return f"{value:.6g}"
        case str():
            return repr(value) if len(value) <= LONGEST_VALUE else f"{value[: LONGEST_VALUE - 1]!r}…"
        case tuple() | list():
            few = [short(each) for each in value[:9]] if len(value) <= 9 else []
            return _joined("(", few, ")", f"<{len(value)} items>", len(few) == len(value))
        case Mapping():
            names = [f"{key}: {short(each)}" for key, each in value.items()] if len(value) <= 9 else []
            return _joined("{", names, "}", f"<{len(value)} items>", len(names) == len(value))
    return _array(value) if hasattr(value, "tolist") and hasattr(value, "shape") else _of_object(value)


def _array(value: Any) -> str:
    """An array of NumPy, which is not imported for this; a row of few numbers is written out."""
    if not value.shape:
        return short(value.tolist())
    few = [short(each) for each in value.tolist()] if len(value.shape) == 1 and len(value) <= 9 else []
    return _joined("[", few, "]", f"<array {'×'.join(map(str, value.shape))}>", len(few) == value.size)


def _of_object(value: Any) -> str:
    """A record by its name; short ones as they are."""
    name = getattr(value, "name", None)
    if isinstance(name, str):
        return f"<{type(value).__name__} {name[:LONGEST_VALUE]}>"
    text = repr(value) if type(value).__module__.startswith("mbd_sim.") else ""
    return text if text and len(text) <= LONGEST_VALUE else f"<{type(value).__name__}>"


def _joined(opening: str, texts: list[str], closing: str, otherwise: str, complete: bool) -> str:
    text = opening + ", ".join(texts) + closing
    return text if complete and len(text) <= LONGEST_VALUE else otherwise


def _owner(value: object) -> str:
    """The name of the mechanism that an object belongs to, as far as an attribute has it."""
    own = getattr(value, "__dict__", {})
    for attribute in OWNERS:
        owner = own.get(attribute) or own.get(f"_{attribute}")
        name = getattr(getattr(owner, "mechanism", owner), "name", None)
        if isinstance(name, str):
            return f" {name[:LONGEST_VALUE]}"
    return ""
