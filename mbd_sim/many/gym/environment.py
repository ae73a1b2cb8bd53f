"""Any mechanism as a Gymnasium environment, and ready-made learning tasks, registered as `mbd_sim/NAME-v0`.

Rewards and ends of episodes are functions of one simulation, or of all members of an ensemble: the first axis of their
transposed arrays counts coordinates. Of one simulation, its entries are scalars, with which NumPy computes three times
as fast as with arrays without axes. Squares are products: `** 2` of a scalar is rounded differently from an array's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError, InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.notebook.simulation import Simulation
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.pictures.shapes.touching import touching_now
from mbd_sim.simulation.run.arguments import positive_count

try:
    import gymnasium

    from mbd_sim.many.gym.agent_interface import AgentInterface, Limit, require_episodes, require_starts, with_limits
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("mbd_sim.many.gym needs gymnasium: pip install gymnasium", name=error.name) from error


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
            raise InputError(f"there is no render mode '{render_mode}'", "Use 'rgb_array' or None.")
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
        return self._animation.frame(self.simulation.poses(), contacts=touching_now(self.simulation))

    def _observation(self) -> Observation:
        return self._agent.observation(self.simulation.y)


Efforts = NDArray[np.floating[Any]]

EPISODE = 500  # actions: 10 s
RAIL = 1.8  # m, half the length of the rail
LEAN = 0.3  # rad from upright, beyond which the pendulum has fallen
SPEED = 6.0  # rad/s, the desired speed of the four-bar's crank


class Simulated(Protocol):
    """A `Simulation` with q (nq,), or an `Ensemble` with q (k, nq)."""

    @property
    def q(self) -> Array:
        """The generalized coordinates."""
        ...

    @property
    def u(self) -> Array:
        """The generalized speeds."""
        ...


def upright(sim: Simulated, action: Efforts) -> Any:
    """1 if the pendulum stands upright at rest in the middle of the rail, 0 if it hangs."""
    q, rate, push = sim.q.T, sim.u.T[1], action.T[0]
    place, up = q[0], 0.5 * (1.0 - np.cos(q[1]))
    return up - 0.1 * (place * place) - 0.001 * (rate * rate) - 0.0005 * (push * push)


def off_the_rail(sim: Simulated) -> Any:
    """Whether the cart has left the rail."""
    return abs(sim.q.T[0]) > RAIL


def alive(sim: Simulated, action: Efforts) -> Any:
    """1 for each action."""
    return np.ones(action.shape[:-1])


def fallen(sim: Simulated) -> Any:
    """Whether the pendulum has fallen or the cart has left the rail."""
    return off_the_rail(sim) | (abs(np.remainder(sim.q.T[1], 2.0 * math.pi) - math.pi) > LEAN)


def height(sim: Simulated, action: Efforts) -> Any:
    """The height of the tip, from -1 to 1, minus a cost of fast motion."""
    q, u = sim.q.T, sim.u.T
    first, shoulder, elbow = q[0], u[0], u[1]
    up = -0.5 * (np.cos(first) + np.cos(first + q[1]))
    return up - 0.0005 * (shoulder * shoulder + elbow * elbow)


def speed_error(sim: Simulated, action: Efforts) -> Any:
    """Minus the squared relative error of the crank's speed, minus a cost of the effort."""
    error, effort = sim.u.T[0] / SPEED - 1.0, action.T[0]
    return -(error * error) - 1e-5 * (effort * effort)


TASKS: dict[str, dict[str, Any]] = {
    # Swing the pendulum up by pushing the cart, and balance it.
    "CartPendulumSwingUp": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "reward": upright, "terminated": off_the_rail,
    },
    # Balance the upright pendulum.
    "CartPendulumBalance": {
        "mechanism": "cart_pendulum", "actuated": ["rail"], "start_noise": 0.05,
        "start": {"q": [0.0, math.pi]}, "reward": alive, "terminated": fallen,
    },
    # The acrobot (Spong 1995): swing the tip up with a motor at the elbow only.
    "DoublePendulumSwingUp": {
        "mechanism": "double_pendulum", "actuated": ["elbow"], "start_noise": 0.05, "reward": height,
    },
    # Keep the speed of a four-bar's crank constant against the weight of the bars.
    "FourBarSpeed": {
        "mechanism": "four_bar", "actuated": ["crank_pivot"], "start_noise": 0.02,
        "effort_limits": {"crank_pivot": 25.0}, "reward": speed_error,
    },
}  # fmt: skip


def register_tasks() -> None:
    """Register the tasks for `gymnasium.make` and `make_vec`; repeated calls have no effect."""
    for name, task in TASKS.items():
        if (known := f"mbd_sim/{name}-v0") not in gymnasium.registry:
            gymnasium.register(
                known,
                "mbd_sim.many.gym.environment:MechanismEnv",
                vector_entry_point="mbd_sim.many.gym.vector_environment:MechanismVectorEnv",
                max_episode_steps=EPISODE,
                kwargs=task,
            )
