"""Any mechanism as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError
from mbd_sim.base.short_repr import short_repr
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.notebook.simulation import Simulation
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.simulation.run.arguments import positive_count

try:
    import gymnasium

    from mbd_sim.many.gym.agent_interface import AgentInterface, Limit, require_episodes, require_starts, with_limits
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "mbd_sim.many.gym needs gymnasium: pip install gymnasium, or mbd_sim[gym].", name=error.name
    ) from error

if TYPE_CHECKING:
    from mbd_sim.pictures.drawing.animation import Animation

Observation = NDArray[np.float64]
Action = NDArray[np.float32]


class MechanismEnv(gymnasium.Env[Observation, Action]):  # type: ignore[misc]  # mypy skips Gymnasium
    """A mechanism with efforts at joints, or commands of motors; the same seed and actions give the same bits.

    An action has an effort (N or N·m) for each `actuated` coordinate, and a command for each `actuated` actuator or
    drive, each within its limits; for a range of ±1 use
    `gymnasium.wrappers.RescaleAction`. An observation is (q without angles, cos of angles, sin of angles, u), in SI
    units. `reward` and `terminated` receive the `Simulation` after the action, so that they can use q, u, poses,
    energies and reactions. A state that becomes infinite ends the episode, with `info["diverged"]`.

    >>> env = MechanismEnv("double_pendulum", actuated=["elbow"], reward=lambda sim, action: -abs(sim.q[0]))
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  # Gymnasium's own way

    __repr__ = short_repr

    def __init__(
        self,
        mechanism: str | Path | Mechanism,
        actuated: Sequence[str] | None = None,
        *,
        reward: Callable[[Simulation, Action], float],
        terminated: Callable[[Simulation], bool] = lambda sim: False,
        effort_limits: Mapping[str, float] | None = None,
        command_limits: Mapping[str, Limit] | None = None,
        start: Mapping[str, Sequence[float]] | None = None,
        start_noise: float = 0.0,
        trigonometric: bool = True,
        frame_skip: int = 20,
        horizon: int | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (600, 400),
        step: float | None = None,
    ) -> None:
        """Build and compile the mechanism.

        :param mechanism: a file, the name of a shipped mechanism, or a mechanism.
        :param actuated: the names of coordinates with efforts, and of actuators and drives with commands, such as
            `motor`, which is its first channel, or `motor.velocity`; by default the first channel of each actuator and
            drive, or all coordinates if there are none.
        :param reward: called with the simulation and the action that has just been applied.
        :param terminated: called with the simulation; whether the episode ends in this state.
        :param effort_limits: effort limits in N or N·m by coordinate; they replace each `effort_limit` of the file.
        :param command_limits: the largest absolute command, or a pair of bounds, by the name of a command, in the unit
            of its channel; by default the limits of the motor, or those of the joint.
        :param start: "q" and "u" at the start of an episode; they replace those of the file.
        :param start_noise: bound of the uniform noise that is added to q and u at the start, in m, rad and their rates.
        :param trigonometric: observe cos and sin of angles instead of the angles.
        :param frame_skip: integration steps for each action.
        :param horizon: actions after which an episode is truncated; never, if None.
        :param render_mode: None or "rgb_array".
        :param render_size: width and height of a frame in pixels.
        :param step: step size in s; it replaces that of the file.
        :raises MechanismError: with all problems of the file.
        :raises ValueError: an unknown name or render mode, an effort or command without a limit, or a number that
            cannot be used, such as a negative one.
        """
        record = mechanism if isinstance(mechanism, Mechanism) else load_mechanism(mechanism)
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"there is no render mode '{render_mode}'. Use 'rgb_array' or None.")
        require_episodes(start, start_noise, frame_skip, horizon)
        for size in render_size:
            positive_count(size, "a size of frames in pixels")
        self.simulation = Simulation(record, step=step)
        self.reward, self.terminated = reward, terminated
        self.frame_skip, self.horizon, self.start_noise = frame_skip, horizon, start_noise
        self.start = dict(start or {})
        self.render_mode, self._render_size = render_mode, render_size
        self._animation: Animation | None = None
        self._actions, sim = 0, self.simulation
        self.metadata = self.metadata | {"render_fps": round(1.0 / (frame_skip * sim.step_size))}
        limits = with_limits(sim.coordinate_names, sim.effort_map.limits, effort_limits or {})
        sim.effort_map.limit(limits)
        self._agent = AgentInterface(record, sim.model, limits, actuated, trigonometric, command_limits)
        self.actuated = self._agent.actuated
        self.action_space, self.observation_space = self._agent.action_space, self._agent.observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Return to the start, or to the `options` "q" and "u", with noise; loops stay closed.

        :raises ValueError: see `Simulation.reset`; or another option.
        """
        require_starts(options or {})
        super().reset(seed=seed)
        sim, given = self.simulation, self.start | (options or {})
        self._actions = 0
        if not given and not self.start_noise:
            sim.reset()
            return self._observation(), {}
        file, model = sim.model.start, sim.model
        q = np.array(given.get("q", file[model.q_range]), dtype=float)
        u = np.array(given.get("u", file[model.u_range]), dtype=float)
        if self.start_noise and "u" in given:
            sim.reset(q, u)  # refuses speeds that violate the constraints; noise may
        q += self.np_random.uniform(-self.start_noise, self.start_noise, q.shape)
        u += self.np_random.uniform(-self.start_noise, self.start_noise, u.shape)
        sim.reset(q, u, nearest_speeds=bool(self.start_noise) or "u" not in given)
        return self._observation(), {}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply the efforts and commands for `frame_skip` steps.

        :param action: (actuated,) in N or N·m or the units of channels, clipped to the limits.

        :raises CommandError: the action has another shape, or a value that is not finite.
        """
        sim, agent = self.simulation, self._agent
        efforts = agent.efforts(action)
        if agent.has_commands:
            sim.apply_command_values(agent.commands(action, sim.inputs[sim.command_map.range]))
        sim.set_efforts(efforts)
        info: dict[str, Any] = {}
        try:
            sim.step(self.frame_skip)
        except DivergedError as error:
            info["diverged"] = str(error)
        self._actions += 1
        reward = float(self.reward(self.simulation, action))
        ended = bool(info) or bool(self.terminated(self.simulation))
        truncated = self.horizon is not None and self._actions >= self.horizon
        return self._observation(), reward, ended, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """A picture (height, width, 3) as drawn by `mbd_sim check --draw`, or None without a render mode."""
        if self.render_mode is None:
            return None
        if self._animation is None:
            self._animation = Animation(self.simulation.model, *self._render_size)
        return self._animation.frame(self.simulation.poses())

    def _observation(self) -> Observation:
        return self._agent.observation(self.simulation.y)
