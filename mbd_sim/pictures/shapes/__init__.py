"""How a mechanism looks, shared by all renderers: the Rerun viewer, RViz markers, Matplotlib drawings.

| module | contents |
|---|---|
| `palette` | colors of parts, joints, forces and plots; the energy residual on a logarithmic scale |
| `extent` | the box that the motion fills, the length of the mechanism, its plane of motion |
| `solids` | the solid that stands for each kind of shape; circles, spirals, coils and curved arrows as points |
| `joints` | the size of a joint, the places of drives, the points that leave a trace |
| `primitives` | the list of solids, lines and connectors that viewers in space draw |
| `touching` | the closed contacts of a state |
| `curves` | curves and surfaces given by equations |
| `meshes` | meshes as triangles |
"""
