"""What Gazebo adds to the joints of a URDF: springs, in `<gazebo reference="JOINT">`.

`<springStiffness>` is in N·m/rad or N/m, and `<springReference>` in rad or m, the position without a force; both become
those of the joint's axis in SDF. Where several blocks give one, the last counts, as there, and the others are listed.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

from mbd_sim.base.errors import quoted
from mbd_sim.files.text.xml import NUMBER, Element, Reading

GAZEBO = "gazebo"
SPRING = {"springStiffness": "stiffness", "springReference": "rest"}  # their keys in a mechanism file
WITHOUT_EFFECT = ("implicitSpringDamper", "provideFeedback")  # here

Springs = Mapping[str, Mapping[str, float]]


def springs_of(reading: Reading, robot: Element, axial: Container[str]) -> Springs:
    """The keys `stiffness` and `rest` by the joint; everything else in the blocks that have them is listed.

    :param axial: the joints that can have springs.
    """
    found: dict[str, dict[str, float]] = {}
    places: dict[tuple[str, str], Element] = {}
    for block in robot.all(GAZEBO):
        if not has_spring(block):
            continue
        joint = block.attributes.get("reference", "")
        key = f"{GAZEBO}[{joint}]" if joint.isprintable() else GAZEBO
        for element in block.children:
            where = f"{key}.{element.tag}"
            if element.tag in WITHOUT_EFFECT:
                continue
            if element.tag not in SPRING:
                reading.leave_out_at(f"<{element.tag}> of <{GAZEBO}>", element, key)
            elif joint not in axial:
                reading.leave_out_at(f"<{element.tag}> of what has no axis", element, key)
            elif (value := _number(reading, element, where)) is not None:
                if (before := places.get((joint, element.tag))) is not None:
                    reading.leave_out_at(f"<{element.tag}> that is given again", before, key)
                found.setdefault(joint, {})[SPRING[element.tag]] = value
                places[joint, element.tag] = element
    for (joint, tag), element in places.items():
        if "stiffness" not in found[joint]:
            reading.leave_out_at(f"<{tag}> without a stiffness", element, f"{GAZEBO}[{joint}]")
    return {joint: keys for joint, keys in found.items() if keys.get("stiffness")}


def has_spring(block: Element) -> bool:
    """Whether a block gives a part of a spring."""
    return any(element.tag in SPRING for element in block.children)


def _number(reading: Reading, element: Element, key: str) -> float | None:
    text = element.text.strip()
    if not NUMBER.fullmatch(text):
        reading.report(element, key, f"{quoted(text)} is not a number", "Write a plain number.")
        return None
    value = float(text) + 0.0
    if value < 0.0 and SPRING[element.tag] == "stiffness":
        reading.report(element, key, "must not be negative", "Write its size.", text)
        return None
    return value
