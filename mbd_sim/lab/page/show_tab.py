"""What the scene shows besides the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mbd_sim.lab.page.scene import Scene
from mbd_sim.lab.session.session import Session


class ShowTab:
    """Check boxes for traces, arrows and the theme."""

    def __init__(self, gui: Any, session: Session, scene: Scene, dark: bool, darken: Callable[[bool], None]) -> None:
        shown = scene.shown
        traces = gui.add_checkbox("Traces", initial_value=shown.traces)
        contacts = gui.add_checkbox("Contact forces", initial_value=shown.contacts)
        reactions = gui.add_checkbox("Forces through joints", initial_value=shown.reactions)

        def choose(_: Any) -> None:
            shown.traces, shown.contacts, shown.reactions = traces.value, contacts.value, reactions.value
            wanted = reactions.value
            session.ask("reactions", lambda session: setattr(session, "show_reactions", wanted))

        for box in (traces, contacts, reactions):
            box.on_update(choose)
        clear = gui.add_button("Clear the traces", color="gray")
        clear.on_click(lambda _: scene.clear_traces())
        box = gui.add_checkbox("Dark", initial_value=dark)
        box.on_update(lambda _: darken(box.value))
