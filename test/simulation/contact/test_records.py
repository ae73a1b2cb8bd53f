"""What is told of the contacts of a run."""

from mbd_sim.simulation.contact.records import ContactChange, ContactEvent, without_round_off


def test_what_rests_while_another_contact_strikes_is_not_told_as_an_impact():
    """Lines such as "impulse 1.6e-35, loss 25.7 J" of a joint on its stop, dozens in a second."""

    def impact(time, name, impulse):
        return ContactEvent(time, name, ContactChange.IMPACT, impulse, loss=25.7)

    struck, resting, small = impact(1.0, "knee", 3.0), impact(1.0, "hip", -1.6e-15), impact(1.0, "ankle", 1e-9)
    later, closed = impact(2.0, "hip", 1e-15), ContactEvent(1.0, "hip", ContactChange.CLOSED)
    assert without_round_off([resting, struck, closed, small, later]) == [struck, closed, small, later]
