"""A constraint with a law, a play or a capacity is one-sided, whichever kind it is: otherwise it would act both ways."""

import dataclasses
from typing import get_args

import pytest

from mbd_sim.mechanism.elements.constraints import Constraint, ContactLaw, Play, is_one_sided
from mbd_sim.mechanism.values.expression import TimeExpression

KEYS = {
    "ContactLaw | None": ContactLaw(),
    "Play | None": Play(0.1, 0.0),
    "TimeExpression | None": TimeExpression("1", {}),
}
ONE_SIDED = [
    (kind, field.name, KEYS[str(field.type)])
    for kind in get_args(Constraint)
    for field in dataclasses.fields(kind)
    if str(field.type) in KEYS
]


@pytest.mark.parametrize(("kind", "key", "value"), ONE_SIDED)
def test_a_constraint_with_this_key_is_one_sided(kind, key, value):
    required = {
        field.name: None
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    assert not is_one_sided(kind(**required))
    assert is_one_sided(kind(**required | {key: value}))
