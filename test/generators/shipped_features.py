"""Few shipped mechanisms that have together what all of them have."""

import dataclasses

from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped


def features(record):
    """The fields that records set, with the types of joints and elements."""
    if isinstance(record, (dict, list, tuple)):
        for value in record.values() if isinstance(record, dict) else record:
            yield from features(value)
    elif dataclasses.is_dataclass(record):
        for field in dataclasses.fields(record):
            value, kind = getattr(record, field.name), type(record).__name__
            if value is not None and value is not False:
                yield kind, field.name
            if field.name == "type":
                yield kind, value
            yield from features(value)


def mechanisms_with_all_features(most_joints):
    """The names of mechanisms that have all features of the shipped ones with at most so many joints.

    Each is the one with most features that the earlier ones lack; of several, the one with the fewest joints.
    """
    found = {mechanism.name: mechanism for mechanism in map(load_mechanism, sorted(shipped()))}
    missing = {name: set(features(one)) for name, one in found.items() if len(one.all_joints) <= most_joints}
    names = []
    while any(missing.values()):
        best = max(missing, key=lambda name: (len(missing[name]), -len(found[name].all_joints), name))
        names.append(best)
        seen = missing.pop(best)
        missing = {name: left - seen for name, left in missing.items()}
    return names
