"""The way between a node and the process of its page."""

import socket

import pytest

from mbd_sim.lab.session.link import SocketEnd


@pytest.fixture
def ends():
    node, page = socket.socketpair()
    links = SocketEnd(node, blocking=False), SocketEnd(page, blocking=True)
    yield links
    for link in links:
        link.close()


def test_messages_of_any_length_arrive_whole_and_nobody_waits_for_a_page(ends):
    """The node sends more than the pipe holds, at once; the rest follows as the page takes it."""
    node, page = ends
    assert node.receive() is None
    messages = [b"", b"short", bytes(3_000_000)]
    for message in messages:
        node.send(message)
    page.send(b"request")
    assert page.receive() == b""
    assert page.receive() == b"short"
    page._socket.setblocking(False)
    received = None
    while received is None:
        assert node.receive() in (b"request", None)  # sends on
        received = page.receive()
    assert received == messages[2]


def test_the_end_of_the_other_end_is_an_error(ends):
    node, page = ends
    page.close()
    with pytest.raises(OSError, match="closed"):
        node.receive()
