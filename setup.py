"""Build of the ament_python package `mbd_sim`, by colcon or by pip."""

import re
import shutil
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "mbd_sim"
VERSION = re.search(r'^__version__ = "([^"]+)"', Path(NAME, "__init__.py").read_text("utf-8"), re.MULTILINE)[1]
EXAMPLES = Path(NAME, "examples")
START = f"{NAME}.programs:node."  # imports the module that follows; see mbd_sim/programs.py
# Each module of an example's folder that has a main() is a program.
EXAMPLE_PROGRAMS = {
    f"example_{module.stem}": f"{START}examples.{module.parent.name}.{module.stem}.main"
    for module in sorted(EXAMPLES.glob("*/*.py"))
    if "\ndef main(" in module.read_text(encoding="utf-8")
}
ROS_PROGRAMS = {
    "sim_node": f"{START}ros.node.sim_node.main",
    "replay_node": f"{START}ros.replay.replay_node.main",
    **EXAMPLE_PROGRAMS,
}


# What few users need. A function that lacks its package says so, with the line that installs it.
EXTRAS = {
    "cad": ["cadquery-ocp-novtk>=8.0,<9", "lxml>=5.0", "networkx>=3.2", "trimesh>=4.6"],  # reads STEP and 3MF
    "completion": ["argcomplete>=3.1"],  # of commands in a shell
    "control": ["control>=0.10"],  # linear systems as objects of python-control
    "dxf": ["ezdxf>=1.3"],  # drawings from and for CAD
    "foxglove": ["foxglove-sdk>=0.25"],  # shows runs live in Foxglove
    "gym": ["gymnasium>=1.1"],
    "html": ["plotly>=5.20"],  # plots as pages
    "lab": ["viser>=1.1,<2"],  # the mechanism on a page in the browser
    "mesh": ["contourpy>=1.2", "pillow>=10.0", "pycollada>=0.8", "trimesh>=4.6"],
    "mjcf": ["mujoco-core>=4.0"],  # reads MJCF
    "notebook": ["rerun-sdk[notebook]>=0.38"],  # Rerun in notebooks
    "optimization": ["scipy>=1.11"],  # dimensions of linkages, identification
    "sweep": ["dask[distributed]>=2024.1"],  # in parallel
    "symbolic": ["sympy>=1.12.1"],  # equations as formulas
    "tables": ["pyarrow>=14"],  # Parquet
    "video": ["av>=12"],  # animations as MP4
    "view": ["rerun-sdk>=0.38"],
    "xacro": ["xacro>=2.1"],  # expands robot.urdf.xacro; in a ROS 2 installation the package xacro
}
ALL = sorted({requirement for requirements in EXTRAS.values() for requirement in requirements})
# In a ROS 2 installation these come from the system instead. There are wheels for Linux on x86-64 only.
EXTRAS["ros"] = [
    "ros-jazzy-rclpy>=7.1,<8",
    "ros-jazzy-common-interfaces>=5.3,<6",
    "ros-jazzy-rmw-fastrtps-cpp>=8.4,<9",
    *EXTRAS["view"],
]
EXTRAS["ros-kilted"] = [
    "ros-kilted-rclpy>=9.1,<10",
    "ros-kilted-common-interfaces>=5.5,<6",
    "ros-kilted-rmw-fastrtps-cpp>=9.3,<10",
    *EXTRAS["view"],
]


def tree(folder: str) -> list[tuple[str, list[str]]]:
    """The files under a folder, as entries for the share directory of the package."""
    folders = [path for path in [Path(folder), *sorted(Path(folder).rglob("*"))] if path.is_dir()]
    listed = [
        (f"share/{NAME}/{path}", [str(file) for file in sorted(path.iterdir()) if file.is_file()]) for path in folders
    ]
    return [(target, files) for target, files in listed if files]


def example_pages() -> list[tuple[str, list[str]]]:
    """The page and the picture of each example, as entries for the share directory of the package."""
    folders = sorted(page.parent for page in EXAMPLES.glob("*/README.md"))
    return [
        (f"share/{NAME}/examples/{folder.name}", [str(folder / "README.md"), *map(str, sorted(folder.glob("*.png")))])
        for folder in folders
    ]


def ros2_run_scripts() -> tuple[str, list[str]]:
    """A script for each program in lib/, where `ros2 run` looks for it; pip puts the programs into bin/."""
    source, folder = Path("scripts", "ros2_run_program"), Path("build", "ros2_run")
    folder.mkdir(parents=True, exist_ok=True)
    return f"lib/{NAME}", [shutil.copy(source, folder / program) for program in (NAME, *ROS_PROGRAMS)]


data_files = [
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    *tree("config"),
    *tree("launch"),
    *example_pages(),
]
if "bdist_wheel" in sys.argv:
    data_files.append(ros2_run_scripts())
elif "editable_wheel" not in sys.argv:
    data_files.append(("bin", ["scripts/mbd_sim"]))  # on the PATH; colcon puts the programs into lib/

setup(
    name=NAME,
    version=VERSION,
    description="Multibody mechanisms from a plain file, in real time on ROS 2",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    author="mbd_sim maintainers",
    keywords=["multibody dynamics", "mechanisms", "simulation", "robotics", "ROS 2", "Lagrange", "contact"],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Education",
        "Intended Audience :: Manufacturing",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Programming Language :: Python :: 3.13",
        "Programming Language :: Python :: 3.14",
        "Topic :: Scientific/Engineering :: Physics",
        "Topic :: Scientific/Engineering :: Visualization",
        "Typing :: Typed",
    ],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "exports/fmu/sources/*", "studies/sizing/*.yaml"]},
    data_files=data_files,
    zip_safe=True,
    python_requires=">=3.11",
    install_requires=[
        "casadi>=3.8",
        "llvmlite>=0.45",
        "matplotlib>=3.8.4",
        "mcap>=1.5",
        "numpy>=2.0",
        "platformdirs>=4.0; sys_platform != 'linux'",
        "pydantic>=2.14",
        "pyyaml>=6.0",
        "rich>=13.3",
        "rosbags>=0.11",
        "zstandard>=0.21",
    ],
    extras_require=EXTRAS
    | {
        "all": ALL,
        # Besides, real robots, and Pinocchio and Drake as references; without them those tests are skipped.
        "robots": ["drake>=1.30", "example-robot-data>=4", "pin>=3"],
        "test": [
            *ALL,
            "fmpy>=0.3.26",
            "hypothesis>=6.125",
            "jsonschema>=4.20",
            "mcap-ros2-support>=0.5",
            "mypy>=1.10",
            "nox[uv]>=2024.4",
            "playwright>=1.50",
            "psutil>=5.9",
            "pypdf>=4",
            "pytest>=7.4",
            "pytest-timeout>=2.2",
            "pytest-xdist>=3.5",
            "ruff>=0.5",
            "types-PyYAML",
            "websockets>=13",
        ],
        # The site: `make docs`.
        "docs": [
            *(
                requirement
                for extra in ("gym", "optimization", "symbolic", "tables", "view")
                for requirement in EXTRAS[extra]
            ),
            "furo>=2024.8",
            "myst-nb>=1.2",
            "pandas>=2.0",
            "sphinx>=8.1",
            "sphinx-copybutton>=0.5",
            "sphinx-design>=0.6",
            "sphinx-mathjax-offline>=0.0.2",
        ],
    },
    entry_points={
        "console_scripts": [
            "mbd_sim = mbd_sim.programs:command.cli.main.main",
            *(f"{program} = {function}" for program, function in ROS_PROGRAMS.items()),
        ],
    },
)
