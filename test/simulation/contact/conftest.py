"""Fixtures of the tests of contacts."""

import pytest

from mbd_sim.compiler.code import host_module
from mbd_sim.simulation.contact.compiled import library


@pytest.fixture
def compiled_anew(monkeypatch):
    """Compile what happens at contacts in this test, with what it changes, and anew for those after it."""
    monkeypatch.setattr(library, "compile_once", host_module.compile_once)  # quickly
    library.library.cache_clear()
    yield
    library.library.cache_clear()
