"""How a mechanism looks, shared by the three renderers: the Rerun viewer, Matplotlib drawings and RViz markers.

| module | contents |
|---|---|
| `palette` | colors of parts, joints, forces and plots |
| `extent` | the box that the motion fills, the length of the mechanism, its plane of motion |
| `solids` | the solid that stands for each kind of shape |
| `joint_geometry` | radius and axis frame of a joint's marker |
| `polylines` | circles, spirals, coils, dashpots and curved arrows as points |
| `implicit_curves` | curves and surfaces given by equations |
| `trace_points` | the points that leave a trace by default |
| `residual_scale` | the energy residual on a logarithmic scale |
"""
