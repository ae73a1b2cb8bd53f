"""A mechanism in the scene of viser, on a page and in a file.

| module | contents |
|---|---|
| `scene` | parts that move by the pose of their frame, lines between points, traces |
| `vectors`, `arrows` | forces, couples and velocities of a bench, and how they are drawn |
| `ground` | the grid, and the planes that bodies touch |
| `camera` | from where the scene is seen |
| `keep` | the motion as one HTML file |
"""
