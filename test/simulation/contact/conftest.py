"""Fixtures of the tests of contacts."""

import pytest

from mbd_sim.simulation.contact.compiled import library


@pytest.fixture
def compiled_anew():
    """Compile what happens at contacts in this test, with what it changes, and anew for those after it."""
    library.library.cache_clear()
    yield
    library.library.cache_clear()
