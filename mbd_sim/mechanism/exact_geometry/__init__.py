"""Loops whose axes are parallel, or meet, only to the digits of the file: the nearest exact geometry.

| module | |
|---|---|
| `snapping` | the mechanism with exact geometry, and by how much each joint was moved |
| `guides` | constraints that close loops, as joints of massless parts |
| `loop_positions` | a configuration in which all loops are closed as well as their geometry allows |
| `freedoms` | the freedoms of joints as twists, and the gaps of closing joints |
| `targets` | where the axes of all joints are to be, and the ratios of couplings that repeat each other |
| `mobility` | lengths and angles with which loops move that are redundant only together |
| `digits` | how precisely numbers are written |
| `families` | which axes of a loop are meant to be parallel, to coincide, or to meet in a point |
"""
