"""`mbd_sim lab`: the mechanism on a page in the browser, to run, change and take hold of."""

from __future__ import annotations

import argparse
import threading
import webbrowser
from pathlib import Path

from mbd_sim.base.errors import CommandError, NoInertiaError
from mbd_sim.base.packages import require_packages
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism
from mbd_sim.cli.shared.setup_options import add_set, changed_mechanism


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_set(parser)
    parser.add_argument("--port", type=int, default=8080, help="default 8080; 0: any that is free")
    parser.add_argument("--host", default="127.0.0.1", help="listen for other machines too, such as 0.0.0.0")
    parser.add_argument("--no-open", action="store_true", help="only print the address, without opening a browser")
    parser.add_argument("--paused", action="store_true", help="start paused")
    parser.add_argument("--theme", choices=("light", "dark"), default="light", help="default light")
    parser.add_argument("--record", metavar="FILE.mcap", type=Path, help="record from the start")
    parser.add_argument(
        "--drive",
        metavar="JOINT",
        help="show positions only, with this joint moved by hand: the parts need no masses",
    )
    parser.add_argument(
        "--html", metavar="FILE.html", type=Path, help="write a page with the motion of --time seconds, and end"
    )
    parser.add_argument("--time", metavar="SECONDS", type=float, default=10.0, help="with --html, default 10")


def _execute(options: argparse.Namespace) -> int:
    """Write the page with the motion, or serve the page until Ctrl-C.

    :raises CommandError: the port is not possible.
    """
    require_packages("viser", purpose="The lab")
    if not 0 <= options.port <= 65535:
        raise CommandError(f"there is no port {options.port}", "Give one from 1024 to 65535, or 0.")
    mechanism = changed_mechanism(options)
    if options.html is not None:
        from mbd_sim.lab.scene.keep import write_html

        write_html(mechanism, options.html, options.time, dark=options.theme == "dark")
        print(f"wrote {options.html}")
        return 0
    from mbd_sim.lab.lab import Lab

    try:
        lab = Lab(
            mechanism,
            drive=options.drive,
            host=options.host,
            port=options.port,
            theme=options.theme,
            running=not options.paused,
            record=options.record,
        )
    except NoInertiaError as error:
        raise CommandError(str(error).rstrip("."), "Or show positions only: --drive JOINT.") from error
    with lab:
        print(f"{mechanism.name} is on {lab.url} (Ctrl-C ends it)", flush=True)
        if not options.no_open:
            webbrowser.open(lab.url)
        threading.Event().wait()
    return 0


COMMANDS = {
    "lab": Command(
        "Open a page in the browser on which the mechanism runs: play, pause, step, wind back, move sliders, drag "
        "parts, plot, record. Save the file in any editor, and the page follows. The page listens on this machine "
        "only, unless --host is given; then the printed address contains a token. Ctrl-C ends it.",
        _add_arguments,
        _execute,
    ),
}
