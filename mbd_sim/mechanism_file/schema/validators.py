"""What reads values of a type of the schema: built when the first one is read, and without pydantic's plugins."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import RLock
from typing import Any

from pydantic import BaseModel, TypeAdapter

PLUGINS_OFF = "PYDANTIC_DISABLE_PLUGINS"  # a variable of the environment, which pydantic reads for each validator
_building = RLock()


@cache
def validator_of(kind: Any) -> TypeAdapter[Any]:
    """What reads values of a type, and knows its schema."""
    with _without_plugins():
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            kind.model_rebuild()
        return TypeAdapter(kind)


@contextmanager
def _without_plugins() -> Iterator[None]:
    """Build a validator without plugins, to find which pydantic would read a file of every installed package."""
    with _building:  # one after the other, so that each finds the value of the environment
        before = os.environ.get(PLUGINS_OFF)
        os.environ[PLUGINS_OFF] = "__all__"
        try:
            yield
        finally:
            if before is None:
                del os.environ[PLUGINS_OFF]
            else:
                os.environ[PLUGINS_OFF] = before
