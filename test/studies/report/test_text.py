"""The text of reports."""

from mbd_sim.studies.report.text import _contact_lines


def test_open_slots_of_a_pair_with_the_same_gap_have_one_line():
    """A pair of blocks has eight of them, and a heap of twenty bodies 190 pairs."""

    def element(state, gap=0.0, normal=0.0):
        return {"state": state, "gap": gap, "normal": normal}

    elements = {f"c.a_on_b_{slot}": element("open", 0.25) for slot in range(1, 9)}
    elements |= {"floor_1": element("open", 0.25), "floor_2": element("open", 0.5)}
    elements |= {f"c.a_on_d_{slot}": element("sticks", 0.0, 3.0) for slot in (1, 2)}
    assert list(_contact_lines(elements, 1.0)) == [
        "  c.a_on_b_1 to 8: open, gap 0.25",
        "  floor_1: open, gap 0.25",
        "  floor_2: open, gap 0.5",
        "  c.a_on_d_1: sticks, force 3",
        "  c.a_on_d_2: sticks, force 3",
    ]


def test_of_a_contact_with_many_open_pairs_only_the_nearest_is_named():
    pairs = [f"balls.b{i}_on_b{j}" for i in range(12) for j in range(i + 1, 12)]
    elements = {
        name: {"state": "open", "gap": 0.1 + 0.01 * ((7 * k) % 66), "normal": 0.0} for k, name in enumerate(pairs)
    }
    elements[pairs[5]] = {"state": "closed", "gap": 0.0, "normal": 2.0}
    elements["floor"] = {"state": "open", "gap": 0.5, "normal": 0.0}
    assert list(_contact_lines(elements, 1.0)) == [
        "  balls: 65 open, the nearest is balls.b0_on_b1, gap 0.1",
        "  balls.b0_on_b6: closed, force 2",
        "  floor: open, gap 0.5",
    ]
