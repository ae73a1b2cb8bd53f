"""Whatever the shapes and contacts of a file hold: a mechanism, or errors that name lines and remedies."""

import warnings

import pytest
import yaml

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from test.generators.bad_contacts import bad_contacts

SPHERES = """
mechanism: spheres
parts: {a: {shape: {type: sphere, mass: 1, radius: 1}}, b: {shape: SHAPE}}
joints: {a: {type: free, between: [ground, a], position: [0, 0, 5]}, b: {type: free, between: [ground, b]}}
contacts: CONTACTS
"""
SPHERE = "{type: sphere, mass: 1, radius: 1}"


def test_wrong_contacts_are_refused_with_their_line_and_a_remedy_or_give_a_mechanism():
    """Finds a traceback, a warning of NumPy, and follow-up problems without a remedy, in points, outlines and pairs."""
    accepted = 0
    for seed in range(30):
        text = yaml.dump(bad_contacts(seed), Dumper=yaml.CSafeDumper, sort_keys=False)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                accepted += bool(parse_mechanism(text, "file.yaml"))
        except MechanismError as error:
            for problem in error.problems:
                assert problem.remedy and 1 <= problem.line <= text.count("\n") + 1, f"seed {seed}: {problem}"
    assert 2 < accepted < 25


def test_a_part_with_problems_of_its_own_is_not_missed_in_contacts():
    wrong = SPHERES.replace("SHAPE", "{type: hull, mass: 1, points: [[0, 0, 0]]}")
    for contacts in ("{c: {among: all}}", "{c: {parts: all, without: [b], plane: ground}}"):
        with pytest.raises(MechanismError) as caught:
            parse_mechanism(wrong.replace("CONTACTS", contacts))
        (problem,) = caught.value.problems
        assert "at least 4 different points" in problem.message
    for name in ("z", "ground"):
        with pytest.raises(MechanismError, match=f"there is no part '{name}'. Valid: a, b"):
            parse_mechanism(
                SPHERES.replace("SHAPE", SPHERE).replace("CONTACTS", f"{{c: {{among: all, without: [{name}]}}}}")
            )


def test_a_pair_that_several_contacts_name_is_said():
    both = "{c: {between: [a, b]}, d: {among: [b, a]}, floor: {parts: [a, b], plane: ground}}"
    source = parse_mechanism(SPHERES.replace("SHAPE", SPHERE).replace("CONTACTS", both)).source
    assert source.remarks == ("'a', 'b' touch in the contacts 'c', 'd', which all act. Name each pair once.",)
