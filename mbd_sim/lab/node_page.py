"""The process of a node's page: `sim_node` starts it, and it ends with the node."""

from __future__ import annotations

import json
import os
import pickle
import socket
import sys

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.operating_system import lower_priority
from mbd_sim.lab.page.page import Page
from mbd_sim.lab.server.server import PageServer
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.link import PageOrder, SocketEnd
from mbd_sim.lab.session.node_session import NodeSession
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.report.text import cached_report, report_text

NICENESS = 10  # so that the node comes first where there is not enough processor time for both


def main() -> int:
    """Open the page that the node orders over the socket whose number is the first argument; returns the exit code."""
    lower_priority(NICENESS)
    link = SocketEnd(socket.socket(fileno=int(sys.argv[1])), blocking=True)
    message = link.receive()
    assert message is not None
    order: PageOrder = pickle.loads(message)  # noqa: S301  (from the node that started this process)
    try:
        simulation = BaseSimulation(order.mechanism, **order.simulation)
        session = NodeSession(Bench(simulation), link)
        server = PageServer(order.host, order.port)
        Page(session, server, theme="light", check=lambda: report_text(cached_report(order.mechanism)))
    except (MbdSimError, OSError) as error:
        link.send(json.dumps({"failed": str(error)}).encode())
        return 1
    link.send(json.dumps({"address": server.url}).encode())
    session.start()
    session.wait()
    os._exit(0)  # viser's threads would go on for as long as pages are open
