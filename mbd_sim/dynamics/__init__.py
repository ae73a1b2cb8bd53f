"""Kinematics, forces and the equations of motion of a mechanism, as CasADi expressions.

Poses, velocities and wrenches are named in Drake's monogram notation:

- `R_AB` (3, 3) holds the axes of frame B in frame A: it takes components in B to components in A.
- `p_AB` (3,) is the position of B's origin from A's origin in m, expressed in A. The pose `X_AB` is both.
- `V_AB` (6,) = [ω; v] is the velocity of B relative to A, at B's origin and, other than Drake's, expressed in B, in
  rad/s and m/s. A further letter names another frame in which it is expressed: `V_WB_W`.
- `F_B` (6,) = [moment; force] is a wrench about B's origin, expressed in B, in N·m and N.

The frames are W, ground; B, a part's frame, in which the mechanism file gives its points; F and M, the frames of a
joint on its inboard and its outboard side; L, the frame of a link, which is M of the link's inboard joint; and P, the
frame of the inboard link.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbd_sim.lazy_names import lazy_names

if TYPE_CHECKING:
    from mbd_sim.dynamics.assembly import close_loops as close_loops
    from mbd_sim.dynamics.assembly import nearest_speeds as nearest_speeds
    from mbd_sim.dynamics.assembly import tolerated_errors as tolerated_errors
    from mbd_sim.dynamics.cam_check import require_followable_cams as require_followable_cams
    from mbd_sim.dynamics.equations import derive as derive
    from mbd_sim.dynamics.evaluation import evaluated as evaluated
    from mbd_sim.dynamics.singular_start import speeds_of_a_branch as speeds_of_a_branch
    from mbd_sim.dynamics.symbolic_parameters import StructureError as StructureError
    from mbd_sim.dynamics.symbolic_parameters import SymbolicParameters as SymbolicParameters
    from mbd_sim.dynamics.symbolic_parameters import equation_data as equation_data
    from mbd_sim.dynamics.symbolic_parameters import varying_parameters as varying_parameters
else:
    __getattr__ = lazy_names(
        __name__,
        {
            "assembly": ("close_loops", "nearest_speeds", "tolerated_errors"),
            "cam_check": ("require_followable_cams",),
            "equations": ("derive",),
            "evaluation": ("evaluated",),
            "singular_start": ("speeds_of_a_branch",),
            "symbolic_parameters": ("StructureError", "SymbolicParameters", "equation_data", "varying_parameters"),
        },
    )
