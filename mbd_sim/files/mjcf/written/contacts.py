"""The contacts of a mechanism as explicit pairs of an MJCF, whose geoms touch nothing else.

Planes are geoms of the world with the names of their contacts. MuJoCo's contacts have neither a restitution nor static
friction, and are soft. A spring and damper with MuJoCo's own time constant of two steps would let what lands rebound
with up to a quarter of its speed, at any step; those written here take all of it in one step.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import aligning_z
from mbd_sim.files.mjcf.written.bodies import MjcfDocument, add_element, number, placed, text
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Face
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.touching import touching_pairs
from mbd_sim.mechanism.values.names import unique_name

DEFAULT = "0.005 0.0001 0.0001"  # torsional and rolling friction, which condim 3 does not use
RECOVERY = 0.02  # s, in which a depth decreases to 1/e
UNUSED = {"contype": "0", "conaffinity": "0"}


def add_contacts(document: MjcfDocument, geoms: Mapping[tuple[str, int], str]) -> None:
    """Write what MJCF can express of the contacts.

    :param geoms: the names of the geoms by the places of their shapes.
    """
    pairs, others = touching_pairs(document.mechanism)
    for name in others:
        document.leave_out("contacts of points, cams and enclosing parts", name)
    planes: dict[Face, str] = {}
    used, step = set(geoms.values()), document.mechanism.step
    for pair in pairs:
        contact, law = pair.contact, pair.contact.law
        second = pair.second
        if not isinstance(law, ContactLaw):
            document.leave_out("compliant contacts", contact.name)
            continue
        if isinstance(second, Face):
            if second.at.part != GROUND:
                document.leave_out("contacts with planes that move", contact.name)
                continue
            if second not in planes:
                planes[second] = unique_name(contact.name, used)
                used.add(planes[second])
                place = placed(Pose(second.at.point, aligning_z(second.normal)))
                attributes = {"name": planes[second], "type": "plane", "size": "0 0 1", **UNUSED}
                add_element(document.frames[GROUND], "geom", attributes | place)
            other = planes[second]
        elif second in geoms:
            other = geoms[second]
        else:
            other = ""
        if pair.first not in geoms or not other:
            document.leave_out("contacts of shapes that MJCF does not have", contact.name)
            continue
        friction = {"condim": "3", "friction": f"{text(np.array([law.friction] * 2))} {DEFAULT}"}
        attributes = {
            "geom1": geoms[pair.first],
            "geom2": other,
            "solref": f"{number(-1.0 / (RECOVERY * step))} {number(-1.0 / step)}",
        }
        add_element(document.section("contact"), "pair", attributes | (friction if law.friction else {"condim": "1"}))
        if law.restitution:
            document.leave_out("restitution of contacts", contact.name)
        if law.static_friction != law.friction:
            document.leave_out("static friction of contacts", contact.name)
