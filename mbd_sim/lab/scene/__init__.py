"""A mechanism in the scene of viser, on a page and in a file.

| module | contents |
|---|---|
| `scene` | all of it, as a frame has it |
| `bodies`, `traces` | forms that move with parts and follow changed lengths; paths of points |
| `vectors`, `arrows` | forces, couples and velocities of a bench, and how they are drawn |
| `contacts` | closed contacts |
| `target` | where a point shall be, dragged by the user |
| `ground` | the grid, and the planes that bodies touch |
| `camera` | from where the scene is seen |
| `keep` | the motion as one HTML file |
"""
