"""Force elements as plain records: springs and dampers between two points, bushings, applied forces and couples.

Efforts and potentials of the file, which act along joint coordinates, are among them.
"""

from __future__ import annotations

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import ElasticLaw, GreenStrain, Linear, PowerLaw, Varying


@record
class Spring:
    """A spring and a damper in parallel between two points at the distance l.

    The tension along their line is the force of the `law` at the elongation l - `length`, plus `damping` times l'. A
    spring with `mass` has one end on ground; its velocity grows linearly from there to the other end.
    """

    name: str
    first: Attachment
    second: Attachment
    law: ElasticLaw | GreenStrain | Varying
    length: float
    damping: float
    mass: float = 0.0

    @property
    def elastic(self) -> bool:
        """Whether it stores energy, which a spring without stiffness or with a law that varies does not."""
        return not isinstance(self.law, Varying) and self.law != Linear(0.0)

    @property
    def needs_line(self) -> bool:
        """Whether its force has no direction if its ends coincide."""
        smooth = isinstance(self.law, GreenStrain) or (isinstance(self.law, Linear) and self.length == 0.0)
        return self.damping != 0.0 or not smooth


@record
class Damper:
    """A damper between two points.

    With `needs_line` it resists the rate of their distance, along their line, otherwise their relative velocity.
    """

    name: str
    first: Attachment
    second: Attachment
    law: PowerLaw
    needs_line: bool

    @property
    def elastic(self) -> bool:
        """Whether it stores energy: a damper does not."""
        return False

    @property
    def damping(self) -> float:
        """The coefficient of its law."""
        return self.law.coefficient


@record
class AppliedForce:
    """A force in N at a point, or, with `couple`, a moment in N·m on a part, as expressions of time and the state.

    `vector` has components along the columns of `axes` (3, 3), which are fixed in the part `axes_of` or in ground.
    """

    name: str
    at: Attachment
    vector: tuple[TimeExpression, TimeExpression, TimeExpression]
    couple: bool
    axes_of: str
    axes: Array

    @property
    def following(self) -> bool:
        """Whether its axes rotate with a part."""
        return self.axes_of != GROUND


@record
class AppliedEffort:
    """An effort in N or N·m along a named joint coordinate or angular velocity, as an expression of time and state."""

    name: str
    coordinate: str
    effort: TimeExpression


@record
class AppliedPotential:
    """A potential in J as an expression of joint coordinates, and of time; its forces act along the coordinates."""

    name: str
    energy: TimeExpression


@record
class Bushing:
    """An elastic connection of two frames, with the potential ½ zᵀ K z, and dampers with the forces C w.

    z (6,) is the displacement of the second frame's origin along the axes of the first in m, and the rotation vector of
    the second frame relative to the first in rad; w (6,) are the rate of this displacement and the relative angular
    velocity. K = `stiffness` and C = `damping` (6, 6) are symmetric. `first_axes` and `second_axes` (3, 3) are those of
    the frames in their parts. One that is `in_joint` consists of the springs of the joint of its name, between the
    joint's frames.
    """

    name: str
    first: Attachment
    second: Attachment
    first_axes: Array
    second_axes: Array
    stiffness: Array
    damping: Array
    in_joint: bool = False


TwoPointElement = Spring | Damper
ForceElement = Spring | Damper | AppliedForce | AppliedEffort | AppliedPotential | Bushing
