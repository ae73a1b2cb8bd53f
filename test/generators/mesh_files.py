"""Small meshes as files: the same tetrahedron, with corners at the origin and on the axes, in each format."""

import struct

CORNERS = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.3))  # m
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))

_DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>
    <created>2024-01-01T00:00:00</created><modified>2024-01-01T00:00:00</modified>
    <unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis>
  </asset>
  <library_effects><effect id="red-effect"><profile_COMMON><technique sid="common"><lambert>
    <diffuse><color>1 0 0 1</color></diffuse>
  </lambert></technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="red" name="red"><instance_effect url="#red-effect"/></material></library_materials>
  <library_geometries><geometry id="body" name="body"><mesh>
    <source id="places">
      <float_array id="numbers" count="12">CORNERS</float_array>
      <technique_common><accessor source="#numbers" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common>
    </source>
    <vertices id="corners"><input semantic="POSITION" source="#places"/></vertices>
    <triangles material="paint" count="4"><input semantic="VERTEX" source="#corners" offset="0"/><p>FACES</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="scene" name="scene"><node id="node" name="node">
    <translate>0 0 5</translate>
    <instance_geometry url="#body"><bind_material><technique_common>
      <instance_material symbol="paint" target="#red"/>
    </technique_common></bind_material></instance_geometry>
  </node></visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""


def collada() -> str:
    """A COLLADA file: red, in centimeters, its corners 5 cm too low and lifted by their node."""
    numbers = " ".join(f"{100.0 * x:g} {100.0 * y:g} {100.0 * z - 5.0:g}" for x, y, z in CORNERS)
    faces = " ".join(str(corner) for face in FACES for corner in face)
    return _DAE.replace("CORNERS", numbers).replace("FACES", faces)


def wavefront() -> str:
    """An OBJ file."""
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in CORNERS]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES)]) + "\n"


def binary_stl() -> bytes:
    """An STL file."""
    data = bytearray(80) + struct.pack("<I", len(FACES))
    for face in FACES:
        data += struct.pack("<12fH", *(0.0,) * 3, *(value for corner in face for value in CORNERS[corner]), 0)
    return bytes(data)
