"""Kinematics, forces and the equations of motion of a mechanism, as CasADi expressions.

Poses, velocities and wrenches are named in Drake's monogram notation:

- `R_AB` (3, 3) holds the axes of frame B in frame A: it takes components in B to components in A.
- `p_AB` (3,) is the position of B's origin from A's origin in m, expressed in A. The pose `X_AB` is both.
- `V_AB` (6,) = [ω; v] is the velocity of B relative to A, at B's origin and, unlike Drake's, expressed in B, in
  rad/s and m/s. A further letter names another frame in which it is expressed: `V_WB_W`.
- `F_B` (6,) = [moment; force] is a wrench about B's origin, expressed in B, in N·m and N.

The frames are W, ground; B, a part's frame, in which the mechanism file gives its points; F and M, the frames of a
joint on its inboard and its outboard side; L, the frame of a link, which is M of the link's inboard joint; and P, the
frame of the inboard link.
"""
