"""What is read of each element of an SDF within links, joints and frames; everything else is listed."""

from __future__ import annotations

from mbd_sim.sdf.frame_graph import Node, key_of
from mbd_sim.sdf.links import PRODUCTS
from mbd_sim.urdf.unread import note_unread, read
from mbd_sim.urdf.value_reader import Reading
from mbd_sim.urdf.xml_elements import Element

_OWN_POSE = read("rotation_format degrees")
READ = {
    "frame": read("name attached_to", "pose"),
    "link": read("name", "pose inertial", "visual collision", checked=True),
    "joint": read(
        "name type",
        "pose parent child axis axis2 screw_thread_pitch thread_pitch gearbox_ratio gearbox_reference_body",
        checked=True,
    ),
    "pose": read("relative_to rotation_format degrees"),
    **dict.fromkeys(("inertial/pose", "visual/pose", "collision/pose"), _OWN_POSE),
    "inertial": read("auto", "pose mass inertia"),
    "inertia": read("", " ".join(PRODUCTS)),
    "visual": read("name", "pose geometry material"),
    "collision": read("name", "pose geometry"),
    "geometry": read("", "box sphere cylinder capsule mesh", checked=True),
    "box": read("", "size"),
    "sphere": read("", "radius"),
    **dict.fromkeys(("cylinder", "capsule"), read("", "radius length")),
    "mesh": read("", "uri scale"),
    "material": read("", "diffuse"),
    **dict.fromkeys(("axis", "axis2"), read("", "xyz limit dynamics mimic use_parent_model_frame")),
    "xyz": read("expressed_in"),
    "limit": read("", "lower upper effort velocity"),
    "dynamics": read("", "damping friction spring_reference spring_stiffness"),
    "mimic": read("joint axis", "multiplier offset reference"),
}
SCOPES = {  # attributes of models and worlds
    "model": {"name", "canonical_link", "placement_frame", "sdf_version"},
    "world": {"name"},
    "sdf": {"version"},
}


def note_unread_values(reading: Reading, node: Node) -> None:
    """List what is not read of a link, joint or frame."""
    if node.kind in READ:
        note_unread(reading, node.element, key_of(node.element), READ)


def note_unread_attributes(reading: Reading, element: Element) -> None:
    """List the attributes of a model or a world that are not read."""
    for name in element.attributes:
        if name not in SCOPES.get(element.tag, ()) and not name.startswith("xmlns"):
            reading.leave_out_at(f"{name} of <{element.tag}>", element, key_of(element))
