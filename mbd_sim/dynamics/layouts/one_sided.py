"""Where the numbers of contacts are among the inputs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OneSidedLayout:
    """The contact numbers at the end of the inputs, for some gaps and rows: the gaps come first among the rows.

    `closed` (gaps,) are 1 for closed gaps. `active` (rows,) are 1 for rows that are solved for: closed gaps and
    sticking friction. Where these depend on each other they are weights of both signs, see `active_rows.ActiveRows`;
    closed gaps that elastic supports would leave without a force are then not active. `direction` (rows - gaps,) are
    the unit vectors of sliding, 0 without sliding, and `HELD` times that of friction that is at its static limit while
    other forces hold the contact. `given` (rows,) are forces to which those add that are solved for: the self-stress
    that friction at its limits has locked in; where joints with loads slide, the forces at the last event. Functions
    that read forces take all λ from there.
    `signs` (loads,) are those of the forces across the axes of joints whose friction depends on them, where these
    forces have one direction only. `features` are the numbers of the slots, see `feature_rows`. `holders` (pooled,) are
    the numbers of the pairs to which the slots of pools belong, and `wrenches` (6 parts,) what the forces `given` to
    their rows exert on the parts of slots, in ground's axes, for functions that do not know these rows.
    """

    gaps: int
    rows: int
    loads: int = 0
    feature_count: int = 0
    pooled: int = 0
    parts: int = 0

    @property
    def closed(self) -> slice:
        """Of the gaps."""
        return slice(0, self.gaps)

    @property
    def active(self) -> slice:
        """Of all rows."""
        return slice(self.gaps, self.gaps + self.rows)

    @property
    def direction(self) -> slice:
        """Of the rows of friction."""
        return slice(self.gaps + self.rows, 2 * self.rows)

    @property
    def signs(self) -> slice:
        """Of the loads of joints."""
        return slice(2 * self.rows, 2 * self.rows + self.loads)

    @property
    def given(self) -> slice:
        """Of all rows."""
        return slice(self.signs.stop, self.signs.stop + self.rows)

    @property
    def features(self) -> slice:
        """Of all slots, one after the other."""
        return slice(self.given.stop, self.given.stop + self.feature_count)

    @property
    def holders(self) -> slice:
        """Of the slots of all pools."""
        return slice(self.features.stop, self.features.stop + self.pooled)

    @property
    def wrenches(self) -> slice:
        """Of the parts, if there are pools."""
        return slice(self.holders.stop, self.holders.stop + 6 * self.parts)

    @property
    def size(self) -> int:
        """The number of all of them."""
        return 3 * self.rows + self.loads + self.feature_count + self.pooled + 6 * self.parts
