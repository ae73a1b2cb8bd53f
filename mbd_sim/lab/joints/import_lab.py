"""From the parts of a CAD program to a mechanism that runs, on one page: joints are chosen, built, and chosen again."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from mbd_sim.base.errors import CommandError
from mbd_sim.base.packages import require_packages
from mbd_sim.files.load import load_mechanism
from mbd_sim.imports.build import Import
from mbd_sim.imports.choice import Choice
from mbd_sim.lab.joints.choice_page import REPLACE, ChoicePage
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.page.page import Theme
from mbd_sim.lab.server.server import PageServer


class ImportLab:
    """Shows the choice of joints, and after each build the lab of the mechanism, until it is closed."""

    def __init__(
        self, found: Import, choice: Choice, *, host: str = "127.0.0.1", port: int = 8080, theme: Theme = "light"
    ) -> None:
        """Open the page, with a choice to begin with.

        :raises InputError: the mass of a part is not known.
        :raises MissingPackageError: viser is not installed.
        """
        require_packages("viser", purpose="The lab")
        for part in found.assembly.parts:
            found.table.properties(part)
        self._found, self._choice, self._theme = found, choice, theme
        self._known = self._text()  # of the file, as this has read or written it
        self.lab: Lab | None = None
        self._server = PageServer(host, port)
        self.page = self._choose()

    @property
    def url(self) -> str:
        """The address of the page."""
        return self._server.url

    def build(self, choice: Choice, replace: bool) -> None:
        """Write the files of the mechanism, and show it in the lab, paused.

        :param replace: whether the mechanism file is replaced where somebody else has changed it.
        :raises CommandError: it was changed, and is not to be replaced.
        :raises MechanismError: the mechanism cannot be assembled; the choice stays on the page.
        """
        out = self._found.out
        if self._text() != self._known and not replace:
            raise CommandError(f"{out} has been changed", f"Save it under another name, or check *{REPLACE}*.")
        self._found.write(choice)
        self._known, self._choice = self._text(), choice
        self._found.draw(choice)
        back = ("Choose other joints", self._back)
        self.lab = Lab(load_mechanism(out), running=False, theme=self._theme, server=self._server, back=back)
        self.page.close()

    def close(self) -> None:
        """Close the page."""
        self.page.close()
        if self.lab is not None:
            self.lab.close()
        self._server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _back(self) -> None:
        lab, self.lab = self.lab, None
        if lab is not None:  # else the button was pressed twice
            lab.close()
            self.page = self._choose()

    def _choose(self) -> ChoicePage:
        return ChoicePage(self._found, self._choice, self._server, self.build, dark=self._theme == "dark")

    def _text(self) -> str | None:
        """The mechanism file; None if there is none."""
        return self._found.out.read_text(encoding="utf-8") if self._found.out.exists() else None
