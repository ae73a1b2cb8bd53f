"""Who may open the page, and what a hostile page can do."""

import asyncio
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
import websockets
from websockets.datastructures import Headers
from websockets.http11 import Request

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.server.server import Gate, guarded
from test.waiting import wait_until

viser = pytest.importorskip("viser")


def request(path="/", **headers):
    return Request(path, Headers({name.replace("_", "-"): value for name, value in headers.items()}))


def socket(origin, host="127.0.0.1:8080", **more):
    return request(Host=host, Upgrade="websocket", Origin=origin, **more)


def test_only_the_own_page_connects():
    gate = Gate("127.0.0.1")
    assert gate.answer(socket("http://127.0.0.1:8080")) is None
    for origin in ("http://evil.example", "http://127.0.0.1:9999", "null", "", "http://127.0.0.1:8080.evil.example"):
        assert gate.answer(socket(origin)).status_code == 403
    assert gate.answer(request(Host="127.0.0.1:8080", Upgrade="websocket")).status_code == 403


def test_names_that_lead_to_this_machine_are_refused():
    """DNS rebinding: another site's name that resolves to the loopback."""
    gate = Gate("127.0.0.1")
    assert gate.answer(request(Host="evil.example:8080")).status_code == 403
    assert gate.answer(socket("http://evil.example:8080", host="evil.example:8080")).status_code == 403
    assert gate.answer(request(Host="localhost:8080")) is None


def test_other_machines_need_the_token():
    gate = Gate("0.0.0.0")
    assert len(gate.token) >= 20
    assert gate.answer(request(Host="lab:8080")).status_code == 403
    assert gate.answer(request("/?token=wrong", Host="lab:8080")).status_code == 403
    assert gate.answer(request(f"/?token={gate.token}", Host="lab:8080")) is None
    cookie = f"mbd_sim_lab={gate.token}"
    assert gate.answer(socket("http://lab:8080", host="lab:8080", Cookie=cookie)) is None
    assert gate.answer(socket("http://lab:8080", host="lab:8080")).status_code == 403


def test_a_server_that_is_not_behind_the_gate_is_not_used():
    with pytest.raises(Exception, match="cannot be guarded"), guarded(Gate("127.0.0.1")):
        pass


def run(coroutine):
    """Run a coroutine in a thread of its own: Playwright's loop occupies that of the tests with pages."""
    with ThreadPoolExecutor(1) as threads:
        return threads.submit(asyncio.run, coroutine).result()


@pytest.fixture(scope="module")
def lab():
    with Lab(load_mechanism("simple_pendulum"), port=0) as lab:
        yield lab


def connect(lab, origin=None):
    address = lab.url.replace("http", "ws", 1)
    own = lab.url.rstrip("/")
    return websockets.connect(
        address, origin=own if origin is None else origin, subprotocols=[f"viser-v{viser.__version__}"], max_size=None
    )


def test_the_hook_stands_in_front_of_the_server(lab):
    """Fails if a new version of viser starts its server in another way."""

    async def try_it():
        with pytest.raises(websockets.InvalidStatus, match="403"):
            async with connect(lab, "http://evil.example"):
                pass
        async with connect(lab) as connection:
            return len(await connection.recv())

    assert run(try_it()) > 100


def test_no_page_can_open_the_tunnel(lab):
    assert viser._messages.ShareUrlRequest not in lab.page.server._websock_server._incoming_handlers


def go_on(lab):
    """Wait until the run has taken many turns."""
    start = lab.session.turns
    wait_until(lambda: lab.session.turns > start + 30, "the run to go on")
    assert lab.session.frame.running


FLOOD = """
import asyncio, sys, msgspec, websockets

async def flood(address, origin, protocol, uuid):
    message = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": 1.0}})
    async with websockets.connect(address, origin=origin, subprotocols=[protocol], max_size=None) as connection:
        for number in range(10**9):
            await connection.send(message)
            if number == 1000:
                print("flooding", flush=True)

asyncio.run(flood(*sys.argv[1:]))
"""


def test_a_flood_of_messages_does_not_stop_the_run(lab):
    """A page that sends as fast as it can; another process, as in life."""
    address, slider = lab.url.replace("http", "ws", 1), next(iter(lab.page.server.gui._gui_input_handle_from_uuid))
    arguments = (address, lab.url.rstrip("/"), f"viser-v{viser.__version__}", slider)
    with subprocess.Popen([sys.executable, "-c", FLOOD, *arguments], stdout=subprocess.PIPE, text=True) as page:
        try:
            assert page.stdout.readline() == "flooding\n"
            go_on(lab)
            assert page.poll() is None
        finally:
            page.kill()


def test_bytes_that_are_no_message_end_only_the_page_that_sent_them(lab):
    async def send_nonsense():
        async with connect(lab) as good:
            async with connect(lab) as bad:
                await bad.send(b"\x80")
                with pytest.raises(websockets.ConnectionClosed):
                    while True:
                        await bad.recv()
            assert await good.recv()

    run(send_nonsense())
    go_on(lab)
