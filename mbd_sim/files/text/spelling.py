"""How names and keys in a mechanism file are spelled, and which key is meant by another word.

Other words are earlier spellings of a key, common words for it, and what URDF, MJCF and SDF have in its place.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

FORMER_KEYS = {"regularisation": "regularization"}  # still read in their place


def as_written(key: Any, data: Collection[Any]) -> Any:
    """The spelling of a key in the data of a file, which may have a former one."""
    spellings = [former for former, current in FORMER_KEYS.items() if current == key]
    spellings.append(FORMER_KEYS.get(key, key))
    return next((spelling for spelling in spellings if key not in data and spelling in data), key)


# By key: words that stand for it wherever the key is known. Of several keys, the first one that is known counts.
_WORDS = {
    "parts": "part body bodies link links object objects segment segments element elements",
    "joints": "joint hinge hinges connection connections mate mates between pair",
    "forces": "loads load",
    "constraints": "constraint loop loops closure closures coupling couplings equality equalities gear gears",
    "contacts": "contact collision collisions",
    "actuators": "controller controllers",
    "parameters": "parameter params param variables variable constants constant values definitions",
    "integrator": "solver simulation sim integration settings options numerics option",
    "ground": "world fixed_frame environment",
    "gravity": "g gravitation",
    "description": "comment comments about info",
    "position": "angle angles q q0 theta theta0 phi phi0 displacement initial_position initial_angle init_position "
    "pos pos0 position0 angle0 start start_angle start_position x0 initial qpos",
    "velocity": "speed speeds omega omega0 w qd qdot dq u v v0 vel vel0 velocity0 initial_velocity initial_speed rpm "
    "angular_speed angular_velocity rate qvel",
    "angular_velocity": "omega omega0 w angular_speed spin rotation_speed",
    "orientation": "rotation rotate rpy quaternion attitude",
    "stiffness": "k k0 kt spring_constant spring_stiffness spring_rate spring_coefficient elasticity",
    "damping": "c d b damper damping_coefficient damping_constant viscous dashpot viscous_friction",
    "coefficient": "damping damping_coefficient damping_constant c d b viscosity k stiffness",
    "viscous": "damping viscosity",
    "rest": "rest_angle rest_length rest_position equilibrium neutral offset springref spring_reference free_angle",
    "length": "natural_length rest_length free_length unstretched_length initial_length l l0 l_0 distance rest height "
    "thickness",
    "mass": "m weight masses",
    "center": "com cog cm cg centre center_of_mass centre_of_mass mass_center center_of_gravity",
    "inertia": "i j moi moment moments moment_of_inertia moments_of_inertia inertia_tensor inertias",
    "shape": "geometry geom visual collision",
    "shapes": "geometries visuals geoms collisions",
    "meshes": "mesh_files",
    "mesh": "mesh_file model stl",
    "material": "substance density",
    "points": "point frames frame markers sites site attachments attachment_points",
    "between": "bodies body links parts part points connects connect ends from to parent child body1 body2",
    "axis": "direction normal dir rotation_axis axes",
    "axes": "axis direction",
    "normal": "axis direction",
    "direction": "axis normal",
    "limits": "limit range lower upper min max stops stop joint_limits",
    "lower": "min minimum low from",
    "upper": "max maximum high to",
    "friction": "mu coefficient_of_friction friction_coefficient frictionloss coulomb friction_coefficients",
    "coulomb": "mu friction torque force magnitude",
    "restitution": "e cor bounce bounciness coefficient_of_restitution restitution_coefficient elasticity",
    "lead": "pitch thread_pitch thread",
    "mechanism": "name model robot title",
    "xx": "ixx",
    "yy": "iyy",
    "zz": "izz",
    "type": "kind class",
    "end": "to tip",
    "bandwidth": "frequency omega cutoff",
    "point": "at body part of",
    "terms": "joints coefficients factors coordinates",
    "wheel": "body part disc ball",
    "through": "points between via over",
    "force": "value magnitude effort",
    "on": "at part body",
    "coordinate": "joint dof q of",
    "energy": "potential value expression v u",
    "torque_constant": "kt k_t ke motor_constant",
    "resistance": "r ohm",
    "supply": "pressure supply_pressure",
    "track": "track_width width",
    "wheelbase": "wheel_base length",
    "joint": "coordinate axis",
    "actuator": "motor joint",
    "radii": "ratio gear_ratio radius teeth",
    "radius": "r",
    "size": "dimensions dimension dims extents lengths width sides",
    "to": "length end tip direction l",
    "at": "position origin center centre pose location xyz translation pos point",
    "rotate": "rotation orientation rpy euler quaternion quat",
    "drive": "motion motor prescribed driven trajectory",
    "vector": "force torque moment value magnitude direction couple",
    "effort": "torque force moment value magnitude",
    "step": "dt timestep time_step step_size stepsize h delta_t",
    "method": "solver integrator scheme type name",
    "command": "controls mode type",
    "file": "filename path uri mesh",
}  # fmt: skip
_KEYS_BY_WORD: dict[str, list[str]] = {}
for _key, _words in _WORDS.items():
    for _word in _words.split():
        _KEYS_BY_WORD.setdefault(_word, []).append(_key)


def synonym(word: str, known: Collection[str]) -> str:
    """The key for which a common word stands; "" if none of those that are known."""
    keys = (key for form in (word, word.lower()) for key in _KEYS_BY_WORD.get(form, ()))
    return next((key for key in keys if key in known), "")
