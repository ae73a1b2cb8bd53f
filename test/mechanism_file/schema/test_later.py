"""What a file does not have is not imported; what is imported later has the same errors and the same JSON Schema."""

import os
import subprocess
import sys
from typing import Annotated, Any

import pytest
from pydantic import Field, TypeAdapter, ValidationError

from mbd_sim.mechanism_file.schema import contact_schema, sensor_schema
from mbd_sim.mechanism_file.schema.base_schema import Spec
from mbd_sim.mechanism_file.schema.later import BuiltLater, ByType, ImportedLater
from mbd_sim.mechanism_file.schema.sensor_schema import EncoderSpec, ImuSpec
from test.generators.mechanism_texts import PENDULUM, changed, problems_of

BASE = {"base_schema", "deferred_types", "file_schema", "joint_schema", "later", "limits_schema", "validators"}
BUILDERS = {
    "build_context", "elements", "joint_builder", "law_builder", "mechanism_builder", "optional_sections", "part_builder",
    "rotation_builder", "tree_builder", "end_search",
}  # fmt: skip
PROGRAM = """
import sys
from mbd_sim.load import load_mechanism
load_mechanism({path!r})
print(*sys.modules)
"""
SHAPELESS = changed(("    mass: m\n    shape: {type: rod, to: [0, 0, -l]}\n", "    mass: m\n    inertia: [1, 1, 1]\n"))
FORCE = "forces:\n  f: {type: force, at: rod.tip, vector: [0, 0, 1]}\n"
REPEATED = 'forces:\n  "f_{i}": {for: {i: 1..2}, type: force, at: rod.tip, vector: [0, 0, i]}\n'
GROUPS = {
    "no shape": (SHAPELESS, set(), set()),
    "a shape": (PENDULUM, {"shape_schema"}, {"shape_builder"}),
    "a force": (SHAPELESS + FORCE, {"force_schema", "law_schema"}, {"force_builder"}),
    "repeated forces": (SHAPELESS + REPEATED, {"force_schema", "law_schema"}, {"force_builder"}),
    "an empty section": (SHAPELESS + "contacts: {}\n", set(), set()),
}


@pytest.mark.parametrize("group", GROUPS)
def test_only_what_a_file_has_is_imported(group, tmp_path):
    text, schemas, builders = GROUPS[group]
    path = tmp_path / "file.yaml"
    path.write_text(text)
    program = [sys.executable, "-c", PROGRAM.format(path=str(path))]
    environment = {**os.environ, "MBD_SIM_CACHE": ""}
    imported = subprocess.run(program, check=True, capture_output=True, text=True, env=environment).stdout.split()

    def among(package):
        start = f"mbd_sim.mechanism_file.{package}."
        return {name.removeprefix(start) for name in imported if name.startswith(start)}

    assert among("schema") == BASE | schemas
    assert among("builders") == BUILDERS | builders
    records = {f"mbd_sim.mechanism.{name}" for name in ("actuators", "bases", "constraints", "contacts", "sensors")}
    assert not records & set(imported)


class Now(Spec):
    """Fields of types that are built with the record."""

    sensors: dict[str, Annotated[EncoderSpec | ImuSpec, Field(discriminator="type")]] = Field({})
    contact: contact_schema.ContactSpec | None = None
    seed: sensor_schema.Seed = 0


class Then(Spec):
    """The same fields, of types that are built later."""

    sensors: dict[str, Annotated[EncoderSpec | ImuSpec, ByType()]] = Field({})
    contact: Annotated[Any, ImportedLater("contact_schema", "ContactSpec")] | None = None
    seed: Annotated[Any, ImportedLater("sensor_schema", "Seed")] = 0


def errors_of(kind, data):
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(kind).validate_python(data)
    return [
        {**error, "ctx": {key: str(value) for key, value in error.get("ctx", {}).items()}}
        for error in caught.value.errors()
    ]


@pytest.mark.parametrize(
    "data",
    [
        {"sensors": {"a": {"type": "encoder"}, "b": {"type": "imu", "at": 3, "bias": 1}, "c": {"type": "no"}, "d": {}, "e": 3}},
        {"sensors": {"a": {"type": "imu", "at": "p", "angular_velocity": {"noise_density": -1, "limits": 1}}}},
        {"sensors": []},
        {"contact": {"among": ["a"], "friction": -1, "cam": "a"}},
        {"contact": {"between": ["a", "b"], "inside": "perhaps", "normal": [0, 0, 0]}, "seed": 0.5},
        {"contact": {"between": ["a", "b"], "static_friction": 1}},
        {"contact": 3, "seed": "a"},
    ],
)  # fmt: skip
def test_errors_are_those_of_the_type_below_the_location_of_the_field(data):
    found = errors_of(Then, data)
    assert found == errors_of(Now, data)
    assert {error["loc"][0] for error in found} == set(data)


def test_valid_values_are_those_of_the_type():
    encoder = {"type": "encoder", "joint": "pin", "counts": 100}
    data = {"sensors": {"a": encoder}, "contact": {"between": ["a", "b"]}, "seed": "2"}
    now, then = (kind.model_validate(data) for kind in (Now, Then))
    assert then.model_dump() == now.model_dump()
    assert isinstance(then.sensors["a"], EncoderSpec) and isinstance(then.contact, contact_schema.ContactSpec)


def test_a_record_is_built_when_the_first_one_is_read():
    class Record(Spec):
        length: float

    adapter = TypeAdapter(list[Annotated[Any, BuiltLater(Record)]])
    assert not Record.__pydantic_complete__
    assert adapter.validate_python([{"length": 2}]) == [Record(length=2)]
    assert Record.__pydantic_complete__


def test_problems_of_absent_and_present_sections_name_their_keys():
    text = PENDULUM + FORCE.replace("at:", "att:") + "contacts: [1]\nsensors: {s: {type: imu, at: rod, rates: 3}}\n"
    found = [(problem.key, problem.message) for problem in problems_of(text)]
    assert found == [
        ("forces.f", "'at' is missing"),
        ("forces.f.att", "unknown key 'att'"),
        ("contacts", "must be a mapping of keys to values"),
        ("sensors.s.rates", "unknown key 'rates'"),
    ]
