"""Types of the schema that are imported and built when the first value of such a type is read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, get_args

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from mbd_sim.mechanism_file.schema.validators import validator_of

KEY = "type"
_LATER = "mbd_sim_later"  # in the metadata of a schema


class Later(ABC):
    """Marks a field, annotated as `Any`, as one of the type `kind`, whose errors and JSON Schema it has."""

    @property
    @abstractmethod
    def kind(self) -> Any:
        """The type."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._validate, metadata={_LATER: self})

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        # Within definitions, the handler takes a schema as any other, with what its type adds to it.
        return handler(core_schema.definitions_schema(self.own_schema, []))

    @property
    def own_schema(self) -> CoreSchema:
        """The schema of the type itself."""
        return validator_of(self.kind).core_schema

    def _validate(self, value: Any, info: ValidationInfo) -> Any:
        # Pydantic adds the errors of the type to those of the record, each below the location of this field.
        return validator_of(self.kind).validate_python(value, context=info.context)


def whole_schema(schema: Any) -> Any:
    """A schema of pydantic, or that of the type itself if it marks one that is built later."""
    later = schema.get("metadata", {}).get(_LATER)
    return later.own_schema if later is not None else schema


@dataclass(frozen=True)
class ImportedLater(Later):
    """The type `name` of a `module` beside this one."""

    module: str
    name: str

    @property
    def kind(self) -> Any:
        """The type."""
        return getattr(import_module(f"{__package__}.{self.module}"), self.name)


@dataclass(frozen=True)
class BuiltLater(Later):
    """The record `model`."""

    model: Any

    @property
    def kind(self) -> Any:
        """The type."""
        return self.model


class ByType:
    """Marks a union as one of records that differ by their key `type`, each of which is built later."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        choices = {
            tag: handler.generate_schema(Annotated[Any, BuiltLater(model)])
            for model in get_args(source)
            for tag in get_args(model.model_fields[KEY].annotation)
        }
        return core_schema.tagged_union_schema(choices, KEY)
