"""An MJCF as the source of a mechanism: its bodies, joints, equalities, tendons and actuators.

Names are those of the MJCF, and so are the coordinates: a hinge is at its `ref` where the file places its body.
"""

from __future__ import annotations

from pathlib import Path

from mbd_sim.errors import quoted
from mbd_sim.mechanism.source import Source
from mbd_sim.mechanism_file.file_limits import MAX_VALUES, digest_of, file_error, read_text
from mbd_sim.mjcf.actuators import Actuators
from mbd_sim.mjcf.body_tree import BodyTree, key_of
from mbd_sim.mjcf.compiler_options import Context, compiler_of
from mbd_sim.mjcf.equalities import add_equality
from mbd_sim.mjcf.items import ACTUATORS, TENDONS, Defaults, Item
from mbd_sim.mjcf.left_out import note_unread
from mbd_sim.mjcf.mechanism_data import MechanismData
from mbd_sim.mjcf.tendons import Tendon, add_tendon, tendon_of
from mbd_sim.urdf.value_reader import Reading, valid_names
from mbd_sim.urdf.xml_elements import Element, parse_xml

MOST = 1000  # elements of a kind in the list of what was left out
GRAVITY = [0.0, 0.0, -9.81]
CONSTRAINTS = frozenset({"equality", "limit", "frictionloss"})
PASSIVE = frozenset({"spring", "damper"})


def mjcf_source(text: str, file: str) -> Source:
    """An MJCF as the source of a mechanism file, with the origins of its values.

    Problems of single elements are among its `problems`, with which `validate` refuses it. Its `notes` list everything
    that was left out.

    :raises MechanismError: the text is not XML, not MJCF, or a file that it includes cannot be read.
    """
    root = parse_xml(text, file)
    if root.tag != "mujoco":
        remedy = "Give the model that includes this file." if root.tag == "mujocoinclude" else ""
        shown = f"<{root.tag[:60]}>"
        raise file_error(file, root.line, "this is not an MJCF, whose root element is <mujoco>", remedy, value=shown)
    read: dict[str, str] = {}
    _include(root, Path(file).parent, (str(Path(file)),), [0], read)
    source = _source(root, file)
    source.other_files = read
    return source


def _include(element: Element, folder: Path, around: tuple[str, ...], count: list[int], read: dict[str, str]) -> None:
    """Replace each `<include>` by what its file has, and note its digest. Paths are relative to the model's folder."""
    children = []
    for child in element.children:
        if child.tag != "include":
            _include(child, folder, around, count, read)
            children.append(child)
            continue
        name = child.attributes.get("file", "")
        path = folder / name
        if not name or not path.is_file():
            message = "there is no such file" if name else "'file' is missing"
            remedy = "Give its path from the folder of the model."
            raise file_error(child.file, child.line, message, remedy, key="include.file", value=quoted(name))
        if str(path) in around:
            raise file_error(child.file, child.line, "includes itself", "Remove it.", "include.file", quoted(name))
        text = read_text(path)
        read[str(path)] = digest_of(text)
        included = parse_xml(text, str(path))
        count[0] += sum(1 + len(found.attributes) for found in included.walk())
        if count[0] > MAX_VALUES:
            raise file_error(child.file, child.line, f"more than {MAX_VALUES} values are included", "Include less.")
        _include(included, folder, (*around, str(path)), count, read)
        children += included.children
    element.children = children


def _source(root: Element, file: str) -> Source:
    reading = Reading(file, MOST)
    context = Context(reading, compiler_of(root, reading), Defaults(root, reading))
    disabled = _disabled(root)
    tree = BodyTree(root, context)
    if not len(tree.bodies) > 1 and not reading.problems:
        raise file_error(file, root.line, "has no <body>", "Add the bodies of the model.", key="worldbody")
    data = MechanismData(context, tree, _meshes(root, context), disabled)
    _add_rest(root, data, disabled)
    note_unread(root, reading)
    name = root.attributes.get("model") or "model"
    sections = {key: entries for key, entries in data.sections.items() if entries}
    gravity = _options(root, reading, disabled)
    content = {"mechanism": valid_names([name], "model")[name], **gravity, **sections}
    source = Source(content, file=file, problems=reading.problems, origins=data.origins, format="MJCF")
    source.notes = reading.notes
    source.comments = (f"From {Path(file).name}.", *source.notes)
    return source


def _add_rest(root: Element, data: MechanismData, disabled: frozenset[str]) -> None:
    """Add tendons, equalities and actuators."""
    tendons: dict[str, Tendon] = {}
    elements = [element for section in root.all("tendon") for element in section.children if element.tag in TENDONS]
    for number, element in enumerate(elements, start=1):
        if (tendon := tendon_of(data, element, number)) is not None:
            tendons[tendon.name] = tendon
            add_tendon(data, tendon, disabled)
    loops = len(data.sections["joints"])
    for element in (element for section in root.all("equality") for element in section.children):
        if "equality" in disabled:
            data.context.reading.leave_out_at("equalities, which are disabled", element, key_of(element))
        else:
            add_equality(data, element, tendons)
    if len(data.sections["joints"]) > loops or "constraints" in data.sections:
        _let_assembly_move(data)
    actuators = Actuators(data, tendons)
    elements = [element for section in root.all("actuator") for element in section.children]
    for number, element in enumerate(elements, start=1):
        if "actuation" in disabled:
            data.context.reading.leave_out_at("actuators, which are disabled", element, key_of(element))
        elif element.tag in ACTUATORS:
            actuators.add(element, number)
        else:
            data.context.reading.leave_out_at(f"<{element.tag}>", element, key_of(element))
    actuators.add_armature()


def _let_assembly_move(data: MechanismData) -> None:
    """Make the reference positions a guess: constraints may not hold there."""
    for record in data.sections["joints"].values():
        if "position" in record:
            record["guess"] = True


def _meshes(root: Element, context: Context) -> dict[str, Item]:
    found = {}
    for element in (element for asset in root.all("asset") for element in asset.all("mesh")):
        item = context.defaults.item(element, key_of(element))
        found[item.text("name") or Path(item.text("file")).stem] = item
    return found


def _disabled(root: Element) -> frozenset[str]:
    """The forces and constraints that `<flag>` turns off."""
    flags = [flag for option in root.all("option") for flag in option.all("flag")]
    found = frozenset(name for flag in flags for name, word in flag.attributes.items() if word == "disable")
    found |= CONSTRAINTS if "constraint" in found else frozenset()
    return found | (PASSIVE if "passive" in found else frozenset())


def _options(root: Element, reading: Reading, disabled: frozenset[str]) -> dict[str, list[float]]:
    """Gravity; the time step and the medium are only noted."""
    places = {name: option for option in root.all("option") for name in option.attributes}
    item = Item(reading, root, "option", places)
    if (step := item.number("timestep")) and item.has("timestep"):
        reading.leave_out("time step, in place of which integrator.step has its default", f"{step:g} s")
    for name in ("density", "viscosity", "wind"):
        if any(item.numbers(name, 1, 3) or ()):
            reading.leave_out_at("forces of the medium", places[name], f"{name} {item.text(name)}")
    gravity = item.numbers("gravity", 3) or GRAVITY
    gravity = [0.0, 0.0, 0.0] if "gravity" in disabled else gravity
    return {} if gravity == GRAVITY else {"gravity": gravity}
