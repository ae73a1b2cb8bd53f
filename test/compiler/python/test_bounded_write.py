"""The compiled copy of numbers: what it takes, what it leaves to its fallback, and that it then writes nothing."""

import gc
import inspect
import pickle
import sys
import weakref

import numpy as np
import pytest

from mbd_sim.compiler.python.bounded_write import bounded_writer

BEFORE = [7.0, 8.0, 9.0]
BOUNDS = [2.0, np.inf, 0.0]


class Listed(list):
    """A list of another type."""


class View(np.ndarray):
    """An array of another type."""


class Number(float):
    """A number of another type."""


class Target:
    """Memory for three numbers, and what the fallback was called with."""

    def __init__(self, bounds=BOUNDS):
        self.numbers, self.bounds, self.reserved = np.array(BEFORE), np.array(bounds), np.zeros(1, dtype=np.int64)
        self.left = []
        self.write = bounded_writer(self.numbers, self.bounds, self.reserved, self.fallback, "write(numbers)")

    def fallback(self, *arguments, **keywords):
        """Keep the arguments."""
        self.left.append((arguments, keywords))


def misaligned(numbers):
    array = np.zeros(8 * len(numbers) + 1, dtype=np.uint8)[1:].view(float)
    array[:] = numbers
    return array


def read_only(numbers):
    array = np.array(numbers)
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "kind",
    [
        np.array,
        lambda numbers: np.array(numbers, dtype=np.float32),
        lambda numbers: np.repeat(numbers, 2)[::2],
        lambda numbers: np.repeat(np.array(numbers, dtype=np.float32), 3)[::3],
        lambda numbers: np.array(numbers[::-1])[::-1],
        lambda numbers: np.array([numbers, numbers]).T[:, 1],
        lambda numbers: pickle.loads(pickle.dumps(np.array(numbers))),  # with a type object of its own
        read_only,
        list,
        tuple,
    ],
)
def test_numbers_are_written_within_their_bounds(kind):
    for numbers in ([1.5, -1e30, 0.0], [-2.0, 1e-30, -0.0], [3.0, 0.25, 1.0], [-2.5, -0.0, -1.0]):
        given = kind(numbers)
        target = Target()
        target.write(given)
        expected = np.copysign(np.minimum(np.abs(np.asarray(given, dtype=float)), BOUNDS), given)
        assert target.numbers.tobytes() == expected.tobytes()
        assert not target.left


@pytest.mark.parametrize(
    "given",
    [
        *(np.array([1.0, 2.0, 3.0], dtype=kind) for kind in (int, np.float16, np.longdouble, complex, object, bool)),
        *(np.array([1.0, 2.0, 3.0], dtype=kind).astype(f"{'<' if sys.byteorder == 'big' else '>'}{kind}") for kind in ("f4", "f8")),
        misaligned([1.0, 2.0, 3.0]),
        np.ones(2), np.ones(4), np.ones(0), np.ones((3, 1)), np.ones((1, 3)), np.array(1.0), np.float64(1.0),
        np.ones(3).view(View), np.array(["1", "2", "3"]),
        [1.0, 2.0], (1.0, 2.0), [], [1.0, 2.0, 3.0, 4.0], Listed([1.0, 2.0, 3.0]),
        [1.0, 2.0, 3], (1.0, True, 3.0), [1.0, np.float64(2.0), 3.0], [1.0, Number(2.0), 3.0], ["1", "2", "3"],
        {"a": 1.0}, None, 1.0, "123", range(3), iter([1.0, 2.0, 3.0]),
        *(kind(numbers) for kind in (np.array, np.float32, list, tuple)
          for bad in (np.nan, np.inf, -np.inf)
          for numbers in ([bad, 1.0, 2.0], [1.0, 2.0, bad])),
    ],
)  # fmt: skip
def test_everything_else_is_left_to_the_fallback(given):
    target = Target()
    target.write(given)
    ((arguments, keywords),) = target.left
    assert len(arguments) == 1 and arguments[0] is given and not keywords
    assert target.numbers.tolist() == BEFORE


def test_views_of_a_named_type_are_taken_like_arrays():
    target, other = Target(), np.ones(3).view(type("Other", (np.ndarray,), {}))
    write = bounded_writer(target.numbers, target.bounds, target.reserved, target.fallback, "write(numbers)", View)
    write(np.array([1.0, -1.0, 5.0]).view(View))
    assert not target.left and target.numbers.tolist() == [1.0, -1.0, 0.0]
    write(np.array([0.5, 0.0, 0.0]))
    assert not target.left and target.numbers[0] == 0.5
    write(other)
    assert len(target.left) == 1 and target.numbers[0] == 0.5


@pytest.mark.parametrize(
    ("arguments", "keywords"), [((), {}), ((np.ones(3), np.ones(3)), {}), ((), {"numbers": [1.0, 2.0, 3.0]})]
)
def test_other_numbers_of_arguments_are_left_to_the_fallback(arguments, keywords):
    target = Target()
    target.write(*arguments, **keywords)
    assert len(target.left) == 1 and target.left[0][1] == keywords
    assert target.numbers.tolist() == BEFORE


def test_it_can_be_disabled_and_follows_its_bounds():
    target = Target()
    target.reserved[0] = 4
    target.write(np.zeros(3))
    assert len(target.left) == 1 and target.numbers.tolist() == BEFORE
    target.reserved[0] = 0
    target.bounds[:] = 0.5
    target.write(np.ones(3))
    assert len(target.left) == 1 and target.numbers.tolist() == [0.5, 0.5, 0.5]


def test_what_the_fallback_raises_and_returns_comes_through():
    def refuse(given):
        raise ValueError(f"not {given}")

    write = bounded_writer(np.zeros(1), np.ones(1), np.zeros(1, dtype=np.int64), refuse, "write(numbers)")
    with pytest.raises(ValueError, match="not nan"):
        write("nan")
    with pytest.raises(TypeError, match="refuse"):
        write()


def test_no_numbers_at_all():
    empty, left = np.zeros(0), []
    write = bounded_writer(empty, empty, np.zeros(1, dtype=np.int64), left.append, "write(numbers)")
    for given in (np.zeros(0), [], ()):
        assert write(given) is None
    assert not left


def test_it_describes_itself():
    write = Target().write
    assert write.__name__ == "write" and list(inspect.signature(write).parameters) == ["numbers"]
    assert write.__doc__ == "Keep the arguments."


def test_it_leaks_nothing():
    gc.freeze()  # what other tests keep is not searched
    target, given = Target(), [1.0, 2.0, 3.0]
    gone = weakref.ref(target)
    gc.disable()  # garbage of other tests refers to None
    try:
        before = sys.getrefcount(None), sys.getrefcount(given), sys.getrefcount(given[0])
        for _ in range(1000):
            target.write(given)
            target.write(given[:2])
        target.left.clear()
        after = sys.getrefcount(None), sys.getrefcount(given), sys.getrefcount(given[0])
    finally:
        gc.enable()
    assert all(abs(now - then) < 100 for now, then in zip(after, before, strict=True))
    write = target.write
    del target
    gc.collect()
    write(given)
    assert gone().numbers.tolist() == [1.0, 2.0, 0.0]  # the callable keeps what it writes to
    del write
    gc.collect()
    assert gone() is None
