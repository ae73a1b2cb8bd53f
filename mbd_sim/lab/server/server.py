"""A server of viser that lets in this machine alone, or those with the token, and limits how much a page may send.

viser checks neither the origin of a connection nor a token, and limits nothing. A gate stands in front of its server:
every request passes `Gate.answer` before viser sees it, and every message the limit of `Gate`. The server opens no
tunnel, and prints nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import http
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server as websocket_server
from websockets import Headers
from websockets.http11 import Request, Response

from mbd_sim.base.errors import MbdSimError

LOOPBACK = ("127.0.0.1", "localhost", "::1")
COOKIE = "mbd_sim_lab"
MOST_MESSAGES = 400  # a second from one page; more wait in the connection
MOST_PAGES = 32
MOST_BYTES = 16 * 2**20  # of a message: a picture of the page
_PATCH = threading.Lock()


class PageServer:
    """A server for pages one after the other, behind a gate; `viser` is the server itself."""

    def __init__(self, host: str, port: int) -> None:
        """Start it; port 0 is a free one."""
        self._gate = Gate(host)
        self.viser = started(self._gate, host, port, "mbd_sim lab")

    @property
    def url(self) -> str:
        """The address, with the token if there is one."""
        host = self.viser.get_host()
        token = f"?token={self._gate.token}" if self._gate.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.viser.get_port()}/{token}"

    def stop(self) -> None:
        """Stop it."""
        stop(self.viser)


def started(gate: Gate, host: str, port: int, label: str | None = None) -> Any:
    """Start a server behind a gate; port 0 is a free one.

    :raises MbdSimError: this version of viser cannot be guarded.
    """
    import viser
    from viser import _messages

    with guarded(gate), _quiet():
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)  # it would open a tunnel
    return server


def stop(server: Any) -> None:
    """Stop a server."""
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what viser prints through rich, which notebooks would show even where the output is redirected."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


class Gate:
    """Decides on the requests of a server that listens on `host`; `token` is "" where only this machine can connect."""

    def __init__(self, host: str) -> None:
        self.token = "" if host in LOOPBACK else secrets.token_urlsafe(16)
        self.pages = 0

    def answer(self, request: Request) -> Response | None:
        """The refusal of a request; None if it may pass."""
        host = request.headers.get("Host", "")
        if not self.token and urlsplit(f"//{host}").hostname not in LOOPBACK:
            return _refusal("This page is only for the machine that it runs on.")
        if request.headers.get("Upgrade", "").lower() == "websocket":
            if urlsplit(request.headers.get("Origin", "")).netloc != host:
                return _refusal("Another site may not use this page.")
            if self.pages >= MOST_PAGES:
                return _refusal(f"{MOST_PAGES} pages are open already. Close one.")
        if self.token and not self._has_token(request):
            return _refusal("The token is missing. Open the address that the program printed.")
        return None

    def _has_token(self, request: Request) -> bool:
        given = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        return hmac.compare_digest(given.encode(), self.token.encode()) or self._has_cookie(request)

    def _has_cookie(self, request: Request) -> bool:
        cookies = SimpleCookie()
        with contextlib.suppress(CookieError):
            cookies.load("; ".join(request.headers.get_all("Cookie")))
        given = cookies[COOKIE].value if COOKIE in cookies else ""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def admit(self, response: Response | None) -> Response | None:
        """Let a page that was opened with the token remember it; other pages may not show this one in a frame."""
        if response is not None:
            if self.token:
                response.headers["Set-Cookie"] = f"{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            response.headers["Referrer-Policy"] = "no-referrer"
        return response


@contextlib.contextmanager
def guarded(gate: Gate) -> Iterator[None]:
    """While a server of viser is built, put a gate in front of it.

    :raises MbdSimError: viser did not start its server through the hook, so that nothing would be checked.
    """
    original, used = websocket_server.serve, []

    def serve(handler: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        used.append(True)
        inner = options.pop("process_request", None)

        def process_request(connection: Any, request: Request) -> Response | None:
            refused = gate.answer(request)
            if refused is not None or inner is None:
                return refused
            return gate.admit(inner(connection, request))

        async def limited(connection: Any) -> None:
            connection.recv = _throttled(connection.recv)
            gate.pages += 1
            try:
                await handler(connection)
            finally:
                gate.pages -= 1

        options["max_size"] = MOST_BYTES
        return original(limited, *arguments, process_request=process_request, **options)

    with _PATCH:
        websocket_server.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websocket_server.serve = original  # type: ignore[misc]
    if not used:
        raise MbdSimError("This version of viser cannot be guarded", "Install another one: pip install 'viser==1.1.1'")


def _throttled(receive: Callable[[], Any]) -> Callable[[], Any]:
    """`receive`, at most `MOST_MESSAGES` times a second on average: what a page sends beyond that waits at its end."""
    allowance, last = float(MOST_MESSAGES), time.monotonic()

    async def throttled() -> Any:
        nonlocal allowance, last
        now = time.monotonic()
        allowance, last = min(MOST_MESSAGES, allowance + (now - last) * MOST_MESSAGES), now
        if allowance < 1.0:
            await asyncio.sleep((1.0 - allowance) / MOST_MESSAGES)
        allowance -= 1.0
        return await receive()

    return throttled


def _refusal(text: str) -> Response:
    body = f"{text}\n".encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, body)
