"""Build of the ament_python package `mbd_sim`, by colcon or by pip."""

import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "mbd_sim"
EXAMPLES = ["computed_torque", "excite", "identify", "pd_hold", "swing_up", "teleop"]
NODES = ["sim_node", "replay_node", *(f"example_{name}" for name in EXAMPLES)]


def tree(folder: str) -> list[tuple[str, list[str]]]:
    """The files under a folder, as entries for the share directory of the package."""
    folders = [path for path in [Path(folder), *sorted(Path(folder).rglob("*"))] if path.is_dir()]
    listed = [
        (f"share/{NAME}/{path}", [str(file) for file in sorted(path.iterdir()) if file.is_file()]) for path in folders
    ]
    return [(target, files) for target, files in listed if files]


data_files = [
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    *tree("config"),
    *tree("launch"),
    *tree("examples"),
]
if "bdist_wheel" in sys.argv:
    # A wheel does not use install_scripts, so these make the nodes available to `ros2 run`.
    data_files.append((f"lib/{NAME}", [f"scripts/{node}" for node in NODES]))

setup(
    name=NAME,
    version="0.1.0",
    description="Multibody mechanisms from a plain file, in real time on ROS 2",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=data_files,
    zip_safe=True,
    python_requires=">=3.11",
    install_requires=[
        "casadi>=3.6",
        "llvmlite>=0.45",
        "matplotlib>=3.8",
        "mcap>=1.5",
        "numpy>=1.26",
        "pint>=0.24",
        "pydantic>=2.7",
        "pyyaml>=6.0",
        "rerun-sdk>=0.38",
        "rich>=13.0",
        "rosbags>=0.10",
        "sympy>=1.12",
        "zstandard>=0.21",
    ],
    extras_require={
        "gym": ["gymnasium>=1.0"],
        # In a ROS 2 installation these come from the system instead.
        "ros": [
            "ros-jazzy-rclpy>=7.1,<8",
            "ros-jazzy-common-interfaces>=5.3,<6",
            "ros-jazzy-rmw-fastrtps-cpp>=8.4,<9",
        ],
        # Recorded runs as HTML pages and Parquet tables.
        "plot": ["plotly>=5.20", "pyarrow>=14"],
        # Sweeps: tables, and parallel runs.
        "sweep": ["dask[distributed]>=2024.1", "pyarrow>=14"],
        # Real robots, and Pinocchio as the reference for their accelerations; without them those tests are skipped.
        "robots": ["example-robot-data>=4", "pin>=3"],
        "test": [
            "dask[distributed]>=2024.1",
            "gymnasium>=1.0",
            "hypothesis>=6.100",
            "jsonschema>=4.20",
            "mcap-ros2-support>=0.5",
            "mypy>=1.10",
            "plotly>=5.20",
            "psutil>=5.9",
            "pyarrow>=14",
            "pytest>=7.4",
            "pytest-timeout>=2.2",
            "pytest-xdist>=3.5",
            "ruff>=0.5",
            "scipy>=1.11",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "mbd_sim = mbd_sim.cli.main:main",
            "sim_node = mbd_sim.ros.sim_node:main",
            "replay_node = mbd_sim.ros.replay_node:main",
            *(f"example_{name} = mbd_sim.examples.{name}:main" for name in EXAMPLES),
        ],
    },
)
