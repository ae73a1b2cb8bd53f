"""What the scene shows besides the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mbd_sim.lab.page.style import style
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.scene.traces import TIPS, traceable
from mbd_sim.lab.scene.vectors import VIEWS, View
from mbd_sim.lab.session.session import Session


class ShowTab:
    """Check boxes for traces and arrows, for dark ground and for large text."""

    def __init__(
        self, gui: Any, session: Session, scene: Scene, css: Any, *, dark: bool, darken: Callable[[bool], None]
    ) -> None:
        self._session, shown = session, scene.shown
        traces = gui.add_checkbox("Traces", initial_value=shown.traces)
        names = traceable(session.bench.simulation.mechanism)
        traced = gui.add_dropdown("Trace of", names, initial_value=TIPS, hint="tips, or one point: its coupler curve")
        traced.on_update(lambda _: scene.traces.choose(traced.value))
        contacts = gui.add_checkbox("Contact forces", initial_value=shown.contacts)

        def choose(_: Any) -> None:
            shown.traces, shown.contacts = traces.value, contacts.value

        traces.on_update(choose)
        contacts.on_update(choose)
        for view in VIEWS:
            self._add_view(gui, view)
        gui.add_button("Clear the traces", color="gray").on_click(lambda _: scene.traces.forget())
        on_dark = gui.add_checkbox("Dark", initial_value=dark)
        on_dark.on_update(lambda _: darken(on_dark.value))
        large = gui.add_checkbox("Large text", initial_value=False)
        large.on_update(lambda _: setattr(css, "content", style(large=large.value)))

    def _add_view(self, gui: Any, view: View) -> None:
        box = gui.add_checkbox(view.label, initial_value=view.key in self._session.watched)

        def choose(_: Any) -> None:
            def request(session: Session) -> None:
                session.watched.pop(view.key, None)
                if box.value:
                    session.watched[view.key] = view.read

            self._session.ask(f"watch {view.key}", request)

        box.on_update(choose)
