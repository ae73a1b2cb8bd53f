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
