"""The labels and numbers of a published wrench."""

import numpy as np
import pytest

from mbd_sim.simulation.model.wrenches import parse_wrench, wrench_labels


@pytest.mark.parametrize("part", ["upper", "arm.left"])
@pytest.mark.parametrize("axes", ["ground", "part"])
def test_a_wrench_is_read_back_from_labels_and_numbers(part, axes):
    vectors = np.arange(1.0, 7.0), np.zeros(6)
    numbers = np.concatenate([*(vectors if axes == "ground" else vectors[::-1]), [7.0, 8.0, 9.0]])
    labels = wrench_labels(part)
    assert len(labels) == len(numbers) == 15
    wrench = parse_wrench(labels, numbers)
    assert (wrench.part, wrench.axes) == (part, axes)
    assert (*wrench.force, *wrench.couple, *wrench.point) == tuple(range(1, 10))
