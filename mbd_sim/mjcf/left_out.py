"""What is not read from an MJCF: every element and attribute that is in none of these tables is listed."""

from __future__ import annotations

from mbd_sim.mjcf.body_tree import GENERATORS, key_of
from mbd_sim.mjcf.items import ACTUATORS, TENDONS
from mbd_sim.urdf.value_reader import Reading
from mbd_sim.urdf.xml_elements import Element

POSE = {"pos", "quat", "axisangle", "euler", "xyaxes", "zaxis"}
_ACTUATOR = {
    "name", "class", "joint", "jointinparent", "tendon", "site", "body", "cranksite", "slidersite", "gear",
    "ctrllimited", "ctrlrange", "forcelimited", "forcerange", "armature", "damping", "kp", "kv", "dampratio",
    "timeconst", "gainprm", "biasprm", "gaintype", "biastype", "dyntype",
}  # fmt: skip
_TENDON = {
    "name", "class", "stiffness", "damping", "frictionloss", "springlength", "limited", "range", "armature",
}  # fmt: skip
_EQUALITY = {
    "name", "class", "active", "body1", "body2", "site1", "site2", "anchor", "relpose", "joint1", "joint2", "tendon1",
    "tendon2", "polycoef",
}  # fmt: skip
_FLAG = {"gravity", "equality", "limit", "frictionloss", "actuation", "spring", "damper", "constraint", "passive"}

READ: dict[str, set[str]] = {
    "compiler": {
        "angle", "autolimits", "eulerseq", "inertiafromgeom", "balanceinertia", "boundmass", "boundinertia",
        "settotalmass", "inertiagrouprange", "coordinate", "meshdir", "assetdir", "strippath",
    },
    "option": {"gravity", "timestep", "density", "viscosity", "wind"},
    "flag": _FLAG,
    "body": {"name", "childclass", *POSE},
    "worldbody": {"childclass"},
    "frame": {"name", "childclass", *POSE},
    "inertial": {"mass", "diaginertia", "fullinertia", *POSE},
    "joint": {
        "name", "class", "type", "pos", "axis", "stiffness", "damping", "frictionloss", "springref", "ref", "armature",
        "limited", "range", "actuatorfrclimited", "actuatorfrcrange",
    },
    "freejoint": {"name"},
    "geom": {
        "name", "class", "type", "size", "fromto", "mass", "density", "rgba", "mesh", "group", "shellinertia", *POSE,
    },
    "site": {"name", "class", "fromto", *POSE},
    "mesh": {"name", "class", "file", "scale"},
    "default": {"class"},
    "equality": _EQUALITY,
    **dict.fromkeys(TENDONS, _TENDON),
    **dict.fromkeys(ACTUATORS, _ACTUATOR),
}  # fmt: skip
KEEPS_FRAMES = ("body", "frame", "worldbody")
HANDLED = ("joint", "freejoint", "geom", "site", "inertial")  # in bodies; what is special is noted where it is read


def note_unread(root: Element, reading: Reading) -> None:
    """List the elements and attributes of a model that are not read, with their lines."""
    _attributes(root, reading, {"model"})
    for section in root.children:
        if section.tag in ("equality", "actuator", "tendon", "asset"):
            _attributes(section, reading, set())
        match section.tag:
            case "worldbody":
                _bodies(section, reading)
            case "equality" | "actuator":
                for element in section.children:
                    _leaf(element, reading, READ["equality"] if section.tag == "equality" else _ACTUATOR)
            case "tendon":
                for element in section.children:
                    _attributes(element, reading, _TENDON)
                    for inner in element.children:
                        _leaf(inner, reading, {"joint", "coef", "site"})
            case "default":
                _defaults(section, reading)
            case "compiler" | "option":
                _attributes(section, reading, READ[section.tag])
                for element in section.children:
                    if (section.tag, element.tag) == ("option", "flag"):
                        _attributes(element, reading, _FLAG)
                    else:
                        reading.leave_out_at(f"<{element.tag}> of <{section.tag}>", element, key_of(element))
            case "asset":
                for element in section.children:
                    if element.tag == "mesh":
                        _leaf(element, reading, READ["mesh"])
                    else:
                        reading.leave_out_at(f"<{element.tag}>", element, key_of(element))
            case tag:
                reading.leave_out_at(f"<{tag}>", section, key_of(section))


def _bodies(element: Element, reading: Reading) -> None:
    """Of a body or a frame, and all within it."""
    waiting = [element]
    while waiting:
        body = waiting.pop()
        _attributes(body, reading, READ[body.tag])
        for child in body.children:
            if child.tag in HANDLED:
                _leaf(child, reading, READ[child.tag])
            elif child.tag not in (*KEEPS_FRAMES, *GENERATORS):
                reading.leave_out_at(f"<{child.tag}>", child, key_of(child))
        waiting += reversed([child for child in body.children if child.tag in KEEPS_FRAMES])


def _defaults(element: Element, reading: Reading) -> None:
    _attributes(element, reading, READ["default"])
    for child in element.children:
        if child.tag == "default":
            _defaults(child, reading)
        elif child.tag in (*HANDLED, *TENDONS, *ACTUATORS, "equality", "mesh"):
            _leaf(child, reading, READ[child.tag], prefix="default ")
        elif child.tag == "tendon":
            _attributes(child, reading, _TENDON, prefix="default ")
        else:
            reading.leave_out_at(f"<{child.tag}>", child, f"default {child.tag}")


def _leaf(element: Element, reading: Reading, read: set[str], prefix: str = "") -> None:
    """Of an element in which no other is read."""
    _attributes(element, reading, read, prefix)
    for child in element.children:
        reading.leave_out_at(f"<{child.tag}> of <{element.tag}>", child, prefix + key_of(element))


def _attributes(element: Element, reading: Reading, read: set[str], prefix: str = "") -> None:
    for name in element.attributes:
        if name not in read:
            reading.leave_out_at(f"{name} of {element.tag}", element, prefix + key_of(element))
