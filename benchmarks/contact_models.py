"""The same systems with contacts for MuJoCo: with its defaults, and with settings chosen for each of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

FINE = 2e-5  # s, the step of the chosen settings
STIFFNESS = 6.25e6  # 1/s² of contacts with restitution: a twentieth of a radian of their vibration in each step
HARD = "0.9999 0.9999 0.001 0.5 2"
PLANE = '<geom type="plane" size="50 50 1" {contact}/>'


@dataclass(frozen=True)
class System:
    """A shipped mechanism: its state (q, u) at the time `until` in s, from closed forms, and the same for MuJoCo.

    `ours` gives q or u of the reference from those of our mechanism. `model(contact)` is the content of MuJoCo's
    worldbody, with the attributes of contacts, `start` its qvel, and `kept` its coordinates that count. `restitution`
    is None where contacts do not rebound.
    """

    until: float
    q: tuple[float, ...]
    u: tuple[float, ...]
    ours: Callable[[list[float]], list[float]]
    model: Callable[[str], str]
    start: tuple[float, ...]
    kept: tuple[int, ...]
    restitution: float | None = None
    offset: tuple[float, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)


def text(system: System, chosen: bool) -> str:
    """The MJCF model of a system."""
    step, attributes = (FINE, _chosen(system.restitution)) if chosen else (1e-3, {})
    contact = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    option = 'cone="elliptic" impratio="100"' if chosen else ""
    gravity = " ".join(map(str, system.gravity))
    flags = '<flag refsafe="disable"/>' if chosen else ""
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{step}" gravity="{gravity}" {option}>{flags}</option>'
        f"<worldbody>{system.model(contact)}</worldbody></mujoco>"
    )


def _chosen(restitution: float | None) -> Mapping[str, str]:
    if restitution is None:
        return {"solref": f"{2 * FINE} 1", "solimp": HARD}
    return {"solref": f"{-STIFFNESS} {-2.0 * calibrated(restitution) * math.sqrt(STIFFNESS)}", "solimp": HARD}


@cache
def calibrated(restitution: float) -> float:
    """The damping ratio with which a mass rebounds from a contact by this factor, by trials with MuJoCo."""
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _rebound(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


def _rebound(ratio: float) -> float:
    import mujoco

    contact = f'solref="{-STIFFNESS} {-2.0 * ratio * math.sqrt(STIFFNESS)}" solimp="{HARD}"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{FINE}" gravity="0 0 0"><flag refsafe="disable"/></option>'
        f"<worldbody>{_bounce(contact)}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = -1.0 + 1e-9, -1.0
    mujoco.mj_step(model, data, nstep=round(20.0 / (FINE * math.sqrt(STIFFNESS))))
    return float(data.qvel[0])


def _body(position: str, joints: str, geom: str) -> str:
    return f'<body pos="{position}">{joints}{geom}</body>'


def _slide(axis: str, more: str = "") -> str:
    return f'<joint type="slide" axis="{axis}" {more}/>'


TURN = '<joint type="hinge" axis="0 1 0"/>'
ACROSS = _slide("1 0 0") + _slide("0 0 1")


def _bounce(contact: str) -> str:
    geom = f'<geom type="sphere" size="0.04" mass="1" friction="0 0 0" {contact}/>'
    return PLANE.format(contact=contact) + _body("0 0 1.04", _slide("0 0 1"), geom)


def _stops(contact: str) -> str:
    limits = contact.replace("solref", "solreflimit").replace("solimp", "solimplimit")
    joint = _slide("1 0 0", f'limited="true" range="-0.3 0.3" stiffness="20" {limits}')
    return _body("0 0 0", joint, '<geom type="box" size="0.05 0.05 0.05" mass="1"/>')


def _rocking(contact: str) -> str:
    tilt = 0.2
    height = 0.1 * math.sin(tilt) + 0.4 * math.cos(tilt)
    joints = ACROSS + f'<joint type="hinge" axis="0 1 0" ref="{tilt}"/>'
    half = f"{math.cos(tilt / 2)} 0 {math.sin(tilt / 2)} 0"
    geom = f'<geom type="box" size="0.1 0.05 0.4" mass="1" friction="2 0 0" {contact}/>'
    floor = PLANE.format(contact=f'friction="2 0 0" {contact}')
    return floor + f'<body pos="0 0 {height}" quat="{half}">{joints}{geom}</body>'


def _spinning_ball(contact: str) -> str:
    rough = f'friction="0.2 0 0" {contact}'
    geom = f'<geom type="sphere" size="0.1" mass="1" {rough}/>'
    return PLANE.format(contact=rough) + _body("-0.5 0 1", ACROSS + TURN, geom)


def _incline(contact: str) -> str:
    rough = f'friction="0.3 0 0" {contact}'
    geom = f'<geom type="box" size="0.1 0.075 0.05" mass="1" {rough}/>'
    return PLANE.format(contact=rough) + _body("0 0 0.05", ACROSS, geom)


SYSTEMS = {
    "bounce": System(
        3.0, (0.0687074609658,), (-0.0153541333847,), lambda x: x, _bounce, (0.0,), (0,), 0.8, offset=(1.0,)
    ),
    "stops": System(1.5, (0.166097603894,), (-1.28426888664,), lambda x: x, _stops, (4.0,), (0,), 0.7),
    "rocking": System(2.5, (0.0619467530613,), (-0.149108798522,), lambda x: x[2:], _rocking, (0.0, 0.0, 0.0), (2,)),
    "spinning_ball": System(
        1.1,
        (-0.357075644989, 0.111135922361, -31.0731088753),
        (-0.714285714286, 0.239623565783, -7.14285714286),
        lambda x: [x[0], -x[1], x[2]],
        _spinning_ball,
        (1.0, 0.0, -50.0),
        (0, 1, 2),
        0.5,
        offset=(-0.5, 1.0, 0.0),
    ),
    "incline": System(
        1.2,
        (-0.0411146045265,),
        (-1.67142596018,),
        lambda x: x,
        _incline,
        (3.0, 0.0),
        (0,),
        gravity=(-9.81 * math.sin(0.5), 0.0, -9.81 * math.cos(0.5)),
    ),
}
