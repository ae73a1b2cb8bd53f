"""The search for unreachable cycles is as before after a pause, also after an exception."""

import gc
import weakref

import pytest

from mbd_sim import collection_pause
from mbd_sim.collection_pause import paused_collection


@pytest.mark.parametrize("was_on", [True, False])
@pytest.mark.parametrize("fails", [True, False])
def test_it_is_off_in_a_pause_and_as_before_afterwards(was_on, fails):
    before = gc.isenabled()
    try:
        (gc.enable if was_on else gc.disable)()
        try:
            with paused_collection():
                with paused_collection():
                    assert not gc.isenabled()
                assert not gc.isenabled()
                if fails:
                    raise KeyError
        except KeyError:
            assert fails
        assert gc.isenabled() == was_on
    finally:
        (gc.enable if before else gc.disable)()


@pytest.mark.parametrize("are_frozen", [True, False])
def test_objects_made_in_a_pause_are_old_afterwards_unless_others_are_frozen(are_frozen):
    before, frozen_before = gc.isenabled(), gc.get_freeze_count()
    gc.unfreeze()
    try:
        gc.enable()
        if are_frozen:
            gc.freeze()
        frozen = gc.get_freeze_count()
        with paused_collection():
            made = [[]]
        assert gc.get_freeze_count() <= frozen  # some may have been freed
        generations = [any(one is made for one in gc.get_objects(generation=number)) for number in range(3)]
        assert generations[2] != are_frozen
    finally:
        (gc.enable if before else gc.disable)()
        if frozen_before:
            gc.freeze()


def test_cycles_made_in_pauses_do_not_accumulate(monkeypatch):
    class Cycle:
        def __init__(self):
            self.own, self.others = self, [[] for _ in range(2000)]

    before, frozen_before = gc.isenabled(), gc.get_freeze_count()
    gc.unfreeze()
    monkeypatch.setattr(collection_pause, "LEAST", 5000)
    monkeypatch.setattr(collection_pause, "_aged", collection_pause._AgedObjects())
    try:
        gc.enable()
        made = []
        for _ in range(5):
            with paused_collection():
                made.append(weakref.ref(Cycle()))
        assert [one() is None for one in made] == [True, True, True, False, False]
    finally:
        (gc.enable if before else gc.disable)()
        if frozen_before:
            gc.freeze()


def test_nothing_searches_at_a_pause_of_a_program_that_has_frozen_its_objects(monkeypatch):
    before, frozen_before, searches = gc.isenabled(), gc.get_freeze_count(), []
    aged = collection_pause._AgedObjects()
    aged._count = 2 * collection_pause.LEAST
    monkeypatch.setattr(collection_pause, "_aged", aged)

    def note(phase, info):
        searches.append(info["generation"])

    gc.callbacks.append(note)
    try:
        gc.enable()
        gc.freeze()
        with paused_collection():
            pass
        assert 2 not in searches
        gc.unfreeze()
        with paused_collection():
            pass
        assert 2 in searches
    finally:
        gc.callbacks.remove(note)
        (gc.enable if before else gc.disable)()
        if frozen_before:
            gc.freeze()


def test_objects_that_stay_are_not_counted_for_the_next_search(monkeypatch):
    before, frozen_before = gc.isenabled(), gc.get_freeze_count()
    gc.unfreeze()
    aged = collection_pause._AgedObjects()
    monkeypatch.setattr(collection_pause, "_aged", aged)
    try:
        gc.enable()
        with paused_collection(lasting=True):
            made = [[] for _ in range(2000)]
        assert aged._count == 0
        with paused_collection():
            made += [[] for _ in range(2000)]
        assert aged._count >= 2000 and len(made) == 4000
    finally:
        (gc.enable if before else gc.disable)()
        if frozen_before:
            gc.freeze()
