"""How a mechanism looks, shared by the three renderers: the Rerun viewer, Matplotlib drawings and RViz markers.

| module | contents |
|---|---|
| `palette` | colors of parts, joints, forces and plots; the energy residual on a logarithmic scale |
| `extent` | the box that the motion fills, the length of the mechanism, its plane of motion |
| `solids` | the solid that stands for each kind of shape; circles, spirals, coils and curved arrows as points |
| `joints` | radius and axis frame of a joint's marker, drives, the points that leave a trace by default |
| `curves` | curves and surfaces given by equations |
| `meshes` | meshes as triangles |
"""
