"""Random linkages with loops and one-sided rows: slider-cranks, four-bars that strike masses, spatial four-bars."""

from __future__ import annotations

HINGE = {"type": "revolute", "axis": [0, -1, 0]}


def slider_crank(draw):
    """A crank, a rod and a slider between stops, with a floor below the pin or a mass that the slider strikes."""
    crank, rod = draw.number(0.1, 0.3), draw.number(0.5, 0.9)
    parts = {
        name: {"shape": {"type": "rod", "mass": draw.number(0.2, 2), "to": [length, 0, 0]}, "points": {"end": [length, 0, 0]}}
        for name, length in (("crank", crank), ("rod", rod))
    }  # fmt: skip
    parts["slider"] = {"mass": draw.number(0.2, 2)}
    reach = crank + rod
    joints = {
        "crank": {**HINGE, "between": ["ground", "crank"], "position": 0.5, "velocity": draw.number(-15, 15)},
        "pin": {**HINGE, "between": ["crank.end", "rod"], "position": -0.7, "guess": True},
        "slider": {"type": "prismatic", "between": ["ground", "slider"], "axis": [1, 0, 0]},
        "loop": {**HINGE, "between": ["rod.end", "slider"]},
    }
    joints["slider"] |= {"position": 0.95 * reach, "guess": True}
    constraints = {}
    if draw.maybe():
        joints["slider"]["limits"] = {"lower": round(rod - 0.6 * crank, 4), "upper": round(reach + 0.1, 4)}
        joints["slider"]["limits"]["restitution"] = draw.restitution
    if draw.maybe(0.5):
        joints["slider"] |= draw.joint_friction(3.0, False)
    if draw.maybe(0.3):
        joints["crank"] |= draw.joint_friction(0.2, True)
    if draw.maybe():
        floor = {"type": "on_plane", "point": "crank.end", "plane": "ground.floor", "bound": "at_least", **draw.law()}
        constraints["floor"] = floor
    if draw.maybe() or not (constraints or "limits" in joints["slider"]):
        parts["mass"] = {"mass": draw.number(0.2, 2)}
        joints["mass"] = {"type": "prismatic", "between": ["ground", "mass"], "axis": [1, 0, 0]}
        joints["mass"] |= {"position": round(reach + 0.05, 4), "velocity": draw.number(-1, 0)}
        joints["mass"] |= {"stiffness": draw.number(5, 200), "rest": round(rod, 4)}
        strike = {"type": "coupling", "terms": {"mass": 1, "slider": -1}, "bound": "at_least"}
        constraints["strike"] = {**strike, "restitution": draw.restitution}
    points = {"floor": [0, 0, round(-draw.number(0.0, 0.9) * crank, 4)]}
    return {"ground": {"points": points}, "parts": parts, "joints": joints, "constraints": constraints}


def two_loops(draw):
    """Two slider-cranks on one crank, whose sliders have stops and whose crank has a brake or friction."""
    crank = draw.number(0.1, 0.2)
    lengths = draw.number(0.4, 0.7), draw.number(0.4, 0.7)
    ends = {"a": [crank, 0, 0], "b": [0, 0, crank]}
    parts = {"crank": {"mass": 1, "center": [0, 0, 0], "inertia": [0.02] * 3, "points": ends}}
    joints = {"crank": {**HINGE, "between": ["ground", "crank"], "position": 0.3, "velocity": draw.number(-15, 15)}}
    for name, length, axis in zip("ab", lengths, ([1, 0, 0], [0, 0, 1]), strict=True):
        end = [length * part for part in axis]
        parts[f"rod_{name}"] = {"shape": {"type": "rod", "mass": 0.4, "to": end}, "points": {"end": end}}
        parts[f"piston_{name}"] = {"mass": draw.number(0.2, 1)}
        joints[f"pin_{name}"] = {**HINGE, "between": [f"crank.{name}", f"rod_{name}"], "position": -0.3, "guess": True}
        slider = {"type": "prismatic", "between": ["ground", f"piston_{name}"], "axis": axis}
        joints[f"slider_{name}"] = {**slider, "position": length + crank, "guess": True}
        if draw.maybe(0.7):
            lower = round(length - draw.number(0.2, 0.9) * crank, 4)
            limits = {"lower": lower, "upper": round(length + 1.5 * crank, 4), "restitution": draw.restitution}
            joints[f"slider_{name}"]["limits"] = limits
        if draw.maybe(0.4):
            joints[f"slider_{name}"] |= draw.joint_friction(3.0, False)
        joints[f"loop_{name}"] = {**HINGE, "between": [f"rod_{name}.end", f"piston_{name}"]}
    if draw.maybe(0.3) or not any("limits" in joint for joint in joints.values()):
        joints["crank"]["limits"] = {"lower": -3.0, "upper": 1.2, "restitution": draw.restitution}
    return {"parts": parts, "joints": joints}


def spatial_four_bar(draw):
    """A crank and a rocker about axes that are not parallel, coupled by a rod between balls, with stops and a floor."""
    crank, rocker, away = draw.number(0.2, 0.4), draw.number(0.6, 0.9), draw.number(0.8, 1.1)
    parts = {
        "crank": {"shape": {"type": "rod", "mass": 0.5, "to": [0, 0, crank]}, "points": {"end": [0, 0, crank]}},
        "rocker": {"shape": {"type": "rod", "mass": 1, "to": [0, 0, rocker]}, "points": {"end": [0, 0, rocker]}},
    }
    joints = {
        "crank": {"type": "revolute", "between": ["ground", "crank"], "axis": [0, 1, 0], "velocity": draw.number(-8, 8)},
        "rocker": {"type": "revolute", "between": ["ground.pivot", "rocker"], "axis": [0.3, 1, 0.2]},
    }  # fmt: skip
    length = round(draw.number(1.0, 1.2) * away, 4)
    coupler = {"type": "distance", "between": ["crank.end", "rocker.end"], "length": length}
    joints["crank"]["limits"] = {"lower": -1.5, "upper": draw.number(0.3, 1.5), "restitution": draw.restitution}
    joints["rocker"] |= {"position": 0.2, "guess": True}
    if draw.maybe(0.4):
        joints["rocker"] |= draw.joint_friction(0.3, True)
    constraints = {"coupler": coupler}
    if draw.maybe(0.7):
        floor = {"type": "on_plane", "point": "crank.end", "plane": "ground.floor", "bound": "at_least", **draw.law()}
        constraints["floor"] = floor
    points = {"pivot": [away, 0, -0.1], "floor": [0, 0, round(draw.number(0.1, 0.9) * crank, 4)]}
    return {"ground": {"points": points}, "parts": parts, "joints": joints, "constraints": constraints}
