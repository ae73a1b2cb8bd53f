"""Validators are built without pydantic's plugins, and leave the environment as it was."""

import os

import pytest

from mbd_sim.mechanism_file.schema import validators
from mbd_sim.mechanism_file.schema.base_schema import Spec
from mbd_sim.mechanism_file.schema.validators import PLUGINS_OFF, validator_of


@pytest.mark.parametrize("before", [None, "one"])
def test_plugins_are_off_only_while_a_validator_is_built(before, monkeypatch):
    monkeypatch.delenv(PLUGINS_OFF, raising=False)
    if before is not None:
        monkeypatch.setenv(PLUGINS_OFF, before)
    seen = []

    def adapter(kind):
        seen.append(os.environ.get(PLUGINS_OFF))

    monkeypatch.setattr(validators, "TypeAdapter", adapter)
    validator_of.__wrapped__(int)
    assert seen == ["__all__"] and os.environ.get(PLUGINS_OFF) == before


def test_a_record_and_what_reads_it_are_built_once():
    class Record(Spec):
        length: float

    validator = validator_of(Record)
    assert Record.__pydantic_complete__ and validator_of(Record) is validator
    assert validator.validate_python({"length": 1}) == Record(length=1)
