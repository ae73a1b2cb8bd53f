"""Outlines and points from DXF drawings.

| module | contents |
|---|---|
| `drawing` | the lines, arcs and points of a layer, in m |
| `chains` | lines and arcs in any order, joined to closed outlines |
| `source` | the profiles and points of a mechanism file, replaced by what the drawings that they name have |
"""
