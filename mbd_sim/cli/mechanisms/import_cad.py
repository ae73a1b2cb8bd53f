"""`mbd_sim import`: a mechanism file from the parts of a CAD program."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from mbd_sim.base.errors import CommandError, counted
from mbd_sim.cli.shared.command import Command, Waiting
from mbd_sim.cli.shared.common import add_repeatable, positive_in, print_notes
from mbd_sim.cli.shared.page_options import add_page, require_page, serve_page
from mbd_sim.files.load import load_mechanism
from mbd_sim.imports.assembly import CadAssembly
from mbd_sim.imports.build import Import
from mbd_sim.imports.choice import NONE, Choice, choose
from mbd_sim.imports.joints import OFFERED, WORDS, Candidate, candidates_of, word_of
from mbd_sim.imports.masses import MassTable, mass_table
from mbd_sim.imports.meshes import mesh_files, read_meshes
from mbd_sim.imports.step import SUFFIXES, read_step
from mbd_sim.imports.written import UP

GAP = 1e-4  # m
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}  # in m
TYPES = ", ".join([*WORDS, *(kind for kind in OFFERED if kind not in WORDS.values())])


def _add_import(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        metavar="FILE",
        type=Path,
        nargs="+",
        help=f"a STEP file ({', '.join(SUFFIXES)}), or meshes, or a folder of them",
    )
    masses = parser.add_argument_group("masses")
    add_repeatable(
        masses,
        "--density",
        "[PARTS=]MATERIAL",
        "a material such as steel, or a density in kg/m³ or with a unit; PARTS is a name in which * stands for any "
        "letters, and the last match counts; repeatable",
    )
    add_repeatable(masses, "--mass", "PARTS=KG", "the mass of each part of this name; repeatable")
    masses.add_argument("--materials", type=Path, metavar="FILE", help="YAML that maps names of parts to materials")
    joints = parser.add_argument_group("joints")
    joints.add_argument("--joints", choices=["all", NONE], default=NONE, help="take all joints that are found, or none")
    add_repeatable(
        joints,
        "--joint",
        "NUMBER[=TYPE]",
        f"take a joint, by its number or name, perhaps as another type: {TYPES}, or {NONE}; repeatable",
    )
    joints.add_argument(
        "--gap",
        type=positive_in("m"),
        default=GAP,
        metavar="M",
        help="distance up to which faces touch, in m or with a unit (default: 0.1mm)",
    )
    joints.add_argument(
        "--ground", metavar="PART", help=f"the part that does not move (default: the largest one), or {NONE}"
    )
    add_repeatable(joints, "--rigid", "NAME", "a sub-assembly that is one part; * stands for any letters; repeatable")
    parser.add_argument("--unit", choices=UNITS, help="the unit of meshes in formats that state none: STL, OBJ and PLY")
    parser.add_argument("--up", choices=UP, default="z", help="the axis that points upward (default: z)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="mechanism file to write (default: NAME.yaml)")
    parser.add_argument(
        "--lab", action="store_true", help="choose the joints on a page in the browser, and run it there"
    )
    add_page(parser.add_argument_group("the page of --lab"))
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def _import(options: argparse.Namespace) -> int:
    """Read the parts, find joints, and write the mechanism file, its meshes and the picture."""
    out: Path = options.out or Path(f"{options.files[0].resolve().stem}.yaml")
    _require_new(out, options.force)
    if options.lab:
        require_page(options)
    table = mass_table(options.density, options.mass, options.materials)
    Waiting.stage("read the parts")
    assembly = _read(options, out.stem)
    table.require_used(assembly)
    Waiting.stage("find the joints")
    found = Import(assembly, table, tuple(candidates_of(assembly, options.gap)), out, options.up)
    choice = choose(assembly, found.candidates, options.joints == "all", options.joint, options.ground)
    if options.lab:
        return _choose_on_page(found, choice, options)
    count = found.write(choice)
    Waiting.stage("draw the picture")
    found.draw(choice)
    Waiting.stage("load the mechanism")
    _report(assembly, table, found.candidates, choice)
    load_mechanism(out)
    meshes = f", {found.folder} with {counted(count, 'STL file')}," if count else ""
    print(f"wrote {out}{meshes} and {found.picture}")
    return 0


def _choose_on_page(found: Import, choice: Choice, options: argparse.Namespace) -> int:
    """Serve the page on which joints are chosen, and then the mechanism, until Ctrl-C."""
    from mbd_sim.lab.joints.import_lab import ImportLab

    print_notes(list(found.assembly.notes))
    with ImportLab(found, choice, host=options.host, port=options.port, theme=options.theme) as lab:
        serve_page(f"the choice of joints of {found.assembly.name}", lab.url, options)
    return 0


def _require_new(out: Path, force: bool) -> None:
    if out.suffix not in (".yaml", ".yml"):
        raise CommandError(f"--out {out}: a mechanism file has the suffix .yaml", f"Write {out.with_suffix('.yaml')}.")
    if out.exists() and not force:
        raise CommandError(f"{out} exists, and may contain changes", "Add --force to replace it, or --out.")


def _read(options: argparse.Namespace, name: str) -> CadAssembly:
    """The assembly in the files.

    :raises CommandError: there are several STEP files, or an option that does not fit them.
    """
    files: list[Path] = options.files
    steps = [file for file in files if file.suffix.lower() in SUFFIXES]
    if not steps:
        if options.rigid:
            raise CommandError("--rigid names sub-assemblies of STEP, and meshes have none", "Leave it out.")
        return read_meshes(mesh_files(files), UNITS.get(options.unit), name)
    if len(files) > 1:
        raise CommandError("one STEP file is imported at a time", "Export the assembly as one file.")
    if options.unit:
        raise CommandError("a STEP file states its unit", "Leave out --unit.")
    return read_step(files[0], options.rigid)


def _report(assembly: CadAssembly, table: MassTable, candidates: Sequence[Candidate], choice: Choice) -> None:
    """Print the parts and the joints."""
    print_notes(list(assembly.notes))
    print("\n".join(_aligned([["part", "mass", "material"], *_part_rows(assembly, table)])))
    if not candidates:
        print("\nno joints were found: no two parts share a face (--gap is the distance up to which they do)")
        return
    print(
        "\n"
        + "\n".join(
            _aligned([["joint", "parts", "offered", "taken", "because they"], *_joint_rows(candidates, choice)])
        )
    )
    held = f"{choice.held[0]} is {'free' if choice.is_free else 'fixed to ground'} (--ground)"
    if len(choice.held) > 1:
        held += f"; not connected, and held until a joint is taken: {', '.join(choice.held[1:])}"
    print(f"\n{held}")


def _part_rows(assembly: CadAssembly, table: MassTable) -> Iterator[list[str]]:
    for part in assembly.parts:
        materials = dict.fromkeys(str(table.material_of(part, placed) or "") for placed in part.bodies)
        given = "mass given" if table.mass_of(part) is not None else ", ".join(materials)
        yield [part.name, f"{table.properties(part).mass:.6g} kg", given]


def _joint_rows(candidates: Sequence[Candidate], choice: Choice) -> Iterator[list[str]]:
    for one in candidates:
        taken = choice.types.get(one.number)
        yield [str(one.number), " – ".join(one.parts), word_of(one.type), word_of(taken) if taken else "", one.why]


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """The lines of a table, aligned at the left."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


COMMANDS = {
    "import": Command(
        "Write a mechanism file from a STEP assembly of a CAD program, or from closed meshes: a part for each solid, "
        "with its mass and inertia by the materials that are given, its mesh and its color. Faces that parts share are "
        "offered as joints, with numbers that a picture shows. Take them with --joints all or --joint, in the browser "
        "with --lab, or later in the file, which has the others as comments.",
        _add_import,
        _import,
    ),
}
