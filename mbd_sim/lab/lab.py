"""The lab: a session, its page, and the watch on its file, put together."""

from __future__ import annotations

import html
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from mbd_sim.base.packages import require_packages
from mbd_sim.lab.page.page import Page, Theme
from mbd_sim.lab.server.server import PageServer
from mbd_sim.lab.session.background import FileWatch
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.continuation import continue_run
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.positions import PositionBench
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.run.simulation import BaseSimulation

HEIGHT = 640  # px of the page in a notebook


class Lab:
    """The page of a mechanism; it runs until it is closed.

    >>> from mbd_sim import load_mechanism
    >>> from mbd_sim.lab.lab import Lab
    >>> with Lab(load_mechanism("four_bar"), port=0) as lab:  # doctest: +SKIP
    ...     input(lab.url)
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        theme: Theme = "light",
        running: bool = True,
        drive: str | None = None,
        record: Path | None = None,
        start: BaseSimulation | None = None,
        server: PageServer | None = None,
        back: tuple[str, Callable[[], None]] | None = None,
    ) -> None:
        """Build the mechanism, start its session, and open the server.

        :param drive: a joint: positions only are shown, moved by it, and no part needs a mass.
        :param host: where it listens; other machines can connect with the token in `url` if it is not the loopback.
        :param port: 0: a free one.
        :param record: an .mcap file that is recorded from the start.
        :param start: a simulation of the mechanism, whose present state is that of the page at first.
        :param server: one that goes on when the lab is closed, instead of one at `host` and `port`.
        :param back: see `Page`.
        :raises MechanismError: with all problems of the file.
        :raises MissingPackageError: viser is not installed.
        """
        require_packages("viser", purpose="The lab")
        self._drive = drive
        if start is None:
            bench = self._bench(mechanism)
        else:
            method, step = start.model.method_name, start.step_size
            bench = Bench.of(mechanism, method=method, step=step, live=list(start.live))
            continue_run(bench.simulation, start, bench.file)
        self.session = OwnSession(bench, running=running and drive is None)
        if record is not None:
            self.session.record(record)
        self._server = server or PageServer(host, port)
        self._owns_server = server is None
        self.page = Page(self.session, self._server, theme=theme, check=self._checked, back=back)
        self._watch: FileWatch | None = None
        if mechanism.source.file and Path(mechanism.source.file).is_file():
            self._watch = FileWatch(mechanism, self._bench, self._adopt, self.page.refuse)
            self._watch.start()
        self.session.start()

    def __repr__(self) -> str:
        return f"<Lab of {self.session.bench.simulation.mechanism.name} at {self.url}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{html.escape(self.url)}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'

    @property
    def url(self) -> str:
        """The address of the page."""
        return self._server.url

    def close(self) -> None:
        """Close the page, and complete the recording."""
        if self._watch is not None:
            self._watch.stop()
        self.page.stop()
        self.session.stop()
        if self._owns_server:
            self._server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _bench(self, mechanism: Mechanism) -> Bench:
        return Bench.of(mechanism) if self._drive is None else PositionBench.driven(mechanism, self._drive)

    def _adopt(self, bench: Bench) -> None:
        self.page.accept()
        self.session.ask("adopt", lambda session: session.adopt(bench))

    def _checked(self) -> str:
        from mbd_sim.studies.report.text import cached_report, report_text

        if self._drive is not None:
            return "Positions only: masses and forces have no effect."

        return report_text(cached_report(self.session.bench.simulation.mechanism))
