"""A run goes on in another simulation: of the file as it was saved, or with more values that can change."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.base.errors import CommandError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES
from mbd_sim.simulation.run.run_point import recorded_state
from mbd_sim.simulation.run.simulation import BaseSimulation


def continue_run(new: BaseSimulation, other: BaseSimulation, file: Mapping[str, float]) -> None:
    """Go on where another simulation is, as far as names agree.

    These are the time, coordinates and speeds, states and commands of actuators, efforts, and live values that
    were changed there and that both files have alike. Where lengths differ, loops are closed from there. The energy
    account goes on with the same residual.

    :param file: the live values of the other file.
    :raises CommandError: the loops cannot be closed there, or parts would be inside each other.
    """
    changed = {key: value for key, value in other.prepare_live({}).given.items() if file[key] == new.live.get(key)}
    y, inputs, live = new.state, new.inputs.copy(), new.live
    if changed:
        prepared = new.prepare_live(changed, reassemble=True)
        inputs[new.model.input_layout.values], live = prepared.inputs, prepared.current
    steps = max(0, round(other.time / new.step_size))
    places, speeds = _placed(new, other, y)
    new.restore(y, steps, inputs, live=live)
    _assemble(new, places, speeds)
    if np.allclose(new.state, y, rtol=0.0, atol=1e-12):
        new.restore(y, steps, inputs, live=live)  # without the round-off of closing
    y = new.state
    new.model.hold_start(y, inputs)
    _take_over_inputs(new, other, inputs)
    _take_over_actuators(new, other, y)
    same = other.mechanism is new.mechanism
    history = other.history if same and y.size == other.state.size else None
    if same:
        inputs[new.model.input_layout.one_sided] = other.inputs[other.model.input_layout.one_sided]
    new.restore(y, steps, inputs, other.start_energy, live, other.samples if same else None, history)
    if not same:
        new.restore(y, steps)  # contacts by the gaps of the new file
        change = new.energies.residual - other.energies.residual
        new.restore(new.state, steps, new.inputs.copy(), other.start_energy + change)


def _placed(new: BaseSimulation, other: BaseSimulation, y: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Put coordinates of the same names into a state y, with loops as they are; these coordinates and their speeds."""
    places = dict(zip(other.coordinate_names, other.model.coordinates(other.y).tolist(), strict=True))
    speeds = dict(zip(other.coordinate_names, other.u.tolist(), strict=True))
    model, names = new.model, new.coordinate_names
    if names == other.coordinate_names and new.q.size == other.q.size:
        y[model.q_range], y[model.u_range] = other.q, other.u
    else:
        own = dict(zip(names, model.coordinates(y).tolist(), strict=True))
        y[:] = recorded_state(
            model,
            y,
            np.array([places.get(name, own[name]) for name in names]),
            np.array([speeds.get(name, 0.0) for name in names]),
        )
    return {name: places[name] for name in names if name in places}, {
        name: speeds[name] for name in names if name in speeds
    }


def _assemble(simulation: BaseSimulation, places: Mapping[str, float], speeds: Mapping[str, float]) -> None:
    """Close the loops with the given coordinates, or else with one of them.

    :raises CommandError: it is not possible.
    """
    if not places:
        return
    try:
        simulation.set_state(places, speeds)
    except CommandError as refused:
        for name in places:
            try:
                simulation.set_state({name: places[name]}, {name: speeds[name]})
                return
            except CommandError:
                continue
        raise refused


def _take_over_inputs(new: BaseSimulation, other: BaseSimulation, inputs: Array) -> None:
    """Write efforts, commands and wrenches of the same names into inputs."""
    own, given = new.model.input_layout, other.model.input_layout
    pairs = [
        (new.coordinate_names, own.efforts, other.coordinate_names, given.efforts),
        (new.command_map.names, own.commands, other.command_map.names, given.commands),
    ]
    for names, where, others, there in pairs:
        values = dict(zip(others, other.inputs[there].tolist(), strict=True))
        inputs[where] = [values.get(name, old) for name, old in zip(names, inputs[where].tolist(), strict=True)]
    for part in own.wrenches.keys() & given.wrenches.keys():
        inputs[own.wrenches[part]] = other.inputs[given.wrenches[part]]


def _take_over_actuators(new: BaseSimulation, other: BaseSimulation, y: Array) -> None:
    """Write the states of actuators of the same names, and the energies of the audit, into a state."""
    before = other.y
    y[-len(AUDIT_STATES) :] = before[-len(AUDIT_STATES) :]
    if new.model.one_sided is not None and other.model.one_sided is not None:
        y[new.model.loss_range] = before[other.model.loss_range]
    mine, its = new.model.equations.actuators, other.model.equations.actuators
    if mine is None or its is None:
        return
    slots = dict(zip((one.name for one in other.mechanism.actuators), its.layout.slots, strict=True))
    for actuator, own in zip(new.mechanism.actuators, mine.layout.slots, strict=True):
        given = slots.get(actuator.name)
        if given is None:
            continue
        for name in own.states.keys() & given.states.keys():
            y[own.states[name]] = before[given.states[name]]
        if own.delay == given.delay:
            for channel in own.lines.keys() & given.lines.keys():
                start, there = own.lines[channel], given.lines[channel]
                y[start : start + own.delay] = before[there : there + own.delay]
