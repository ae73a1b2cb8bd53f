"""Tests with each version of Python that is found on this machine: `make versions`, or `nox -- ARGUMENTS OF PYTEST`.

`nox --sessions tests-3.13` runs one of them. Versions whose interpreter is not found are skipped.
"""

import platform

import nox

nox.options.error_on_missing_interpreters = False
nox.options.default_venv_backend = "uv|venv"
HAS_ROS_WHEELS = (platform.system(), platform.machine()) == ("Linux", "x86_64")


@nox.session(python=["3.11", "3.12", "3.13", "3.14"])
def tests(session: nox.Session) -> None:
    """Install the package with what its tests need, and run them."""
    # What the ROS wheels of the environment that runs nox have left behind.
    session.env.update({"LD_LIBRARY_PATH": None, "_ROS_WHEELS_BOOTSTRAP_COMPLETE": None})
    session.install("--editable", ".[ros,test]" if HAS_ROS_WHEELS else ".[test]")
    session.run("python", "-m", "pytest", "--numprocesses", "2", "--dist", "worksteal", *session.posargs)
