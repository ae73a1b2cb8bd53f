"""Message packages that the ROS wheels lack, built with the wheels' own interface generators and the system's compiler.

`python -m test.ros_interfaces.build FOLDER` builds `simulation_interfaces`, `tf2_msgs` and parts of `control_msgs` and
`moveit_msgs`, with what the last one depends on, from the `.msg`, `.srv` and `.action` files beside this module. Each package becomes one folder of Python modules with one extension module, which contains
everything that an installed package spreads over several libraries: the C structures, their type support for Fast DDS,
and the conversion to and from Python. With FOLDER on PYTHONPATH a node imports the package like an installed one.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PREFIX = Path(sys.prefix)
MESSAGES = ("builtin_interfaces", "std_msgs", "geometry_msgs")
ACTIONS = ("service_msgs", "unique_identifier_msgs", "action_msgs")  # which actions need
DEPENDENCIES = {
    "simulation_interfaces": (*MESSAGES, *ACTIONS),
    "tf2_msgs": MESSAGES,
    "control_msgs": (*MESSAGES, *ACTIONS, "trajectory_msgs"),
    "object_recognition_msgs": (),
    "moveit_msgs": (*MESSAGES, "service_msgs", "sensor_msgs", "shape_msgs", "trajectory_msgs"),
}
BUILT = {"moveit_msgs": ("object_recognition_msgs",)}  # what a package needs of those that are built before it
SUFFIXES = (".msg", ".srv", ".action")
COMPILERS = {".c": ("gcc", "-std=c11"), ".cpp": ("g++", "-std=c++17")}
FAST_DDS, INTROSPECTION = "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"
GENERATORS = {  # what each generator's function is called, and its arguments
    "rosidl_generator_c": ("generate_c",),
    FAST_DDS: ("generate_typesupport_fastrtps_c",),
    INTROSPECTION: ("generate_c",),
    "rosidl_typesupport_c": ("generate_c", [FAST_DDS, INTROSPECTION]),
    "rosidl_generator_py": ("generate_py", ["rosidl_typesupport_c"]),
}
# Libraries of the wheels that the generated code calls, and those of each package that it depends on.
LIBRARIES = ("rcutils", "rmw", "rosidl_runtime_c", "rosidl_typesupport_c", "fastcdr", FAST_DDS, INTROSPECTION,
             "rosidl_typesupport_fastrtps_cpp", "rosidl_dynamic_typesupport")  # fmt: skip
DEPENDENCY_LIBRARIES = ("rosidl_generator_c", "rosidl_typesupport_c", FAST_DDS, INTROSPECTION, "rosidl_generator_py")


def installed() -> bool:
    """Whether this environment has the packages already, as a full ROS 2 installation may."""
    return all(importlib.util.find_spec(package) for package in DEPENDENCIES)


def is_complete(folder: Path) -> bool:
    """Whether a folder has all the interfaces: an older build may lack some."""
    words = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
    sources = [source.relative_to(HERE) for source in HERE.glob("*/*/*.*") if source.suffix in SUFFIXES]
    return all((folder / source.parent / f"_{words.sub('_', source.stem).lower()}.py").exists() for source in sources)


def missing_tools() -> str:
    """What a build lacks on this machine, or an empty text."""
    if not shutil.which("g++") or not shutil.which("gcc"):
        return "gcc and g++ are not installed"
    if not (Path(sysconfig.get_paths()["include"]) / "Python.h").exists():
        return "the headers of Python are not installed (Debian, Ubuntu: apt install python3-dev)"
    if not (PREFIX / "share/rosidl_generator_py").exists():
        return "the ROS wheels are not installed"
    return ""


def build(folder: Path) -> None:
    """Build every package into `folder`, which appears only when complete."""
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=folder.name) as name:
        for package, dependencies in DEPENDENCIES.items():
            _build_package(package, dependencies, Path(name) / "work" / package, Path(name) / "packages" / package)
        shutil.rmtree(folder, ignore_errors=True)
        (Path(name) / "packages").rename(folder)


def _build_package(package: str, dependencies: Sequence[str], work: Path, target: Path) -> None:
    _generate(package, _to_idl(package, work / "idl"), work)
    shutil.copytree(work / "rosidl_generator_py" / package, target, ignore=shutil.ignore_patterns("*.c"))
    (target / "__init__.py").touch()
    _compile(package, dependencies, work, target)


def _to_idl(package: str, folder: Path) -> list[Path]:
    """Convert `.msg`, `.srv` and `.action` to IDL; returns paths relative to `folder`."""
    adapter = importlib.import_module("rosidl_adapter")
    found = (path for path in (HERE / package).rglob("*.*") if path.suffix in SUFFIXES)
    sources = sorted(path.relative_to(HERE / package) for path in found)
    return [adapter.convert_to_idl(HERE / package, package, source, folder).relative_to(folder) for source in sources]


def _generate(package: str, idl_files: Sequence[Path], work: Path) -> None:
    """Run the generators, each into a folder of its name."""
    idl = {"idl_tuples": [f"{work / 'idl'}:{path}" for path in idl_files]}
    hashes = "rosidl_generator_type_description"
    share = [f"{path.name}:{path}" for path in (PREFIX / "share").iterdir()]
    share += [f"{name}:{work.parent / name / hashes / name}" for name in BUILT.get(package, ())]
    _run_generator(hashes, ("generate_type_hash",), package, work, idl | {"include_paths": share})
    described = [f"{path}:{(work / hashes / package / path).with_suffix('.json')}" for path in idl_files]
    for generator, call in GENERATORS.items():
        _run_generator(generator, call, package, work, idl | {"type_description_tuples": described})


def _run_generator(
    generator: str, call: Sequence[Any], package: str, work: Path, arguments: dict[str, list[str]]
) -> None:
    module = importlib.import_module(generator)
    importlib.import_module("rosidl_pycommon").template_prefix_path.clear()  # file names of templates recur
    templates, output = PREFIX / "share" / generator / "resource", work / generator / package
    (output / "msg").mkdir(parents=True)
    common = {
        "package_name": package, "output_dir": str(output), "template_dir": str(templates), "target_dependencies": [],
    }  # fmt: skip
    file = work / f"{generator}.json"
    file.write_text(json.dumps(common | arguments), encoding="utf-8")
    function, *options = call
    getattr(module, function)(str(file), *options)
    for header in templates.glob("*visibility_control.h.in"):
        text = header.read_text(encoding="utf-8").replace("@PROJECT_NAME@", package)
        text = text.replace("@PROJECT_NAME_UPPER@", package.upper())
        (output / "msg" / header.stem).write_text(text, encoding="utf-8")


def _compile(package: str, dependencies: Sequence[str], work: Path, target: Path) -> None:
    """Compile two libraries, which the dispatching type support finds by name, and the extension module."""
    numpy = importlib.import_module("numpy")
    built = BUILT.get(package, ())
    generated = [folder / name for folder in (work, *(work.parent / name for name in built)) for name in GENERATORS]
    installed = [PREFIX / "include", *(path for path in (PREFIX / "include").iterdir() if path.is_dir())]
    headers = [*generated, *installed, Path(sysconfig.get_paths()["include"]), Path(numpy.get_include())]
    used = [f"-l{name}" for name in LIBRARIES]
    used += [f"-l{dependency}__{part}" for dependency in dependencies for part in DEPENDENCY_LIBRARIES]
    for name in built:  # whose extension module has what others call, too
        used += [f"-L{target.parent / name}", f"-Wl,-rpath,$ORIGIN/../{name}"]
        used += [f"-l:{library.name}" for library in (target.parent / name).glob("*.so")]

    def link(library: str, generators: Sequence[str], *libraries: str) -> None:
        sources = [
            source
            for name in generators
            for source in sorted((work / name).rglob("*.c*"))
            if source.suffix in COMPILERS
        ]
        objects = [source.with_suffix(".o") for source in sources]
        options = ["-O0", "-w", "-fPIC", *(f"-I{path}" for path in headers), "-c"]
        commands = [
            [*COMPILERS[one.suffix], *options, one, "-o", target] for one, target in zip(sources, objects, strict=True)
        ]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(_call, commands))
        folders = [
            f"-L{PREFIX / 'lib'}",
            f"-L{target}",
            "-Wl,-rpath,$ORIGIN",
            f"-Wl,-soname,{library}",
            "-Wl,--no-as-needed",
        ]
        _call(
            ["g++", "-shared", *objects, *folders, *(f"-l{name}" for name in libraries), *used, "-o", target / library]
        )

    link(f"lib{package}__{FAST_DDS}.so", ["rosidl_generator_c", FAST_DDS])
    link(f"lib{package}__{INTROSPECTION}.so", [INTROSPECTION], f"{package}__{FAST_DDS}")
    link(
        f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}",
        ["rosidl_typesupport_c", "rosidl_generator_py"],
        f"{package}__{FAST_DDS}",
        f"{package}__{INTROSPECTION}",
    )


def _call(command: Sequence[str | os.PathLike[str]]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}\n{done.stderr}")


def main(folder: Path) -> None:
    """Build into `folder`; where that is impossible or not needed, leave it empty and say why."""
    if reason := "ROS 2 has them" if installed() else missing_tools():
        print(f"Interfaces for tests are not built: {reason}.")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return
    print(f"Building {', '.join(DEPENDENCIES)} for the tests …")
    with contextlib.redirect_stdout(io.StringIO()):  # the generators report each file
        build(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
