"""Options of commands that open a page of the lab in the browser, and the wait for its end."""

from __future__ import annotations

import argparse
import threading
import webbrowser
from urllib.parse import urlsplit

from mbd_sim.base.errors import CommandError
from mbd_sim.base.packages import require_packages
from mbd_sim.cli.shared.command import Waiting


def add_page(parser: argparse._ActionsContainer) -> None:
    """Add where the page listens, and how it looks."""
    parser.add_argument("--port", type=int, default=8080, help="default 8080; 0: any that is free")
    parser.add_argument("--host", default="127.0.0.1", help="listen for other machines too, such as 0.0.0.0")
    parser.add_argument("--no-open", action="store_true", help="only print the address, without opening a browser")
    parser.add_argument("--theme", choices=("light", "dark"), default="light", help="default light")


def require_page(options: argparse.Namespace) -> None:
    """Refuse a page that cannot be opened, before work is done for it.

    :raises CommandError: the port is not possible.
    :raises MissingPackageError: viser is not installed.
    """
    require_packages("viser", purpose="The lab")
    if not 0 <= options.port <= 65535:
        raise CommandError(f"there is no port {options.port}", "Give one from 1024 to 65535, or 0.")


def serve_page(what: str, url: str, options: argparse.Namespace) -> None:
    """Print the address of a page and open it; until Ctrl-C."""
    if options.port not in (0, urlsplit(url).port):
        print(f"Port {options.port} is taken by another program, so another one is used.")
    Waiting.make_room()
    print(f"{what} is on {url} (Ctrl-C ends it)", flush=True)
    if not options.no_open:
        webbrowser.open(url)
    threading.Event().wait()
