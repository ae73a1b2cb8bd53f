"""Any mechanism as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.errors import CommandError, DivergedError, listed, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.simulation import Simulation

try:
    import gymnasium
    from gymnasium import spaces
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "mbd_sim.gym needs gymnasium: pip install gymnasium, or mbd_sim[gym].", name=error.name
    ) from error

if TYPE_CHECKING:
    from mbd_sim.drawing.animation import Animation

Observation = NDArray[np.float64]
Action = NDArray[np.float32]


class MechanismEnv(gymnasium.Env[Observation, Action]):  # type: ignore[misc]  # mypy skips Gymnasium
    """A mechanism with efforts at some of its joints; the same seed and actions give the same bits.

    An action is an effort (N or N·m) for each `actuated` coordinate, within its limit; for a range of ±1 use
    `gymnasium.wrappers.RescaleAction`. An observation is (q without angles, cos of angles, sin of angles, u), in SI
    units. `reward` and `terminated` receive the `Simulation` after the action, so that they can use q, u, poses,
    energies and reactions. A state that becomes infinite ends the episode, with `info["diverged"]`.

    >>> env = MechanismEnv("double_pendulum", actuated=["elbow"], reward=lambda sim, action: -abs(sim.q[0]))
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  # Gymnasium's own way

    def __init__(
        self,
        mechanism: str | Path | Mechanism,
        actuated: Sequence[str] | None = None,
        *,
        reward: Callable[[Simulation, Action], float],
        terminated: Callable[[Simulation], bool] = lambda sim: False,
        effort_limits: Mapping[str, float] | None = None,
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
        :param actuated: the coordinates with efforts; all by default.
        :param reward: called with the simulation and the action that has just been applied.
        :param terminated: called with the simulation; whether the episode ends in this state.
        :param effort_limits: effort limits in N or N·m by coordinate; they replace each `effort_limit` of the file.
        :param start: "q" and "u" at the start of an episode; they replace those of the file.
        :param start_noise: bound of the uniform noise that is added to q and u at the start, in m, rad and their rates.
        :param trigonometric: observe cos and sin of angles instead of the angles.
        :param frame_skip: integration steps for each action.
        :param horizon: actions after which an episode is truncated; never, if None.
        :param render_mode: None or "rgb_array".
        :param render_size: width and height of a frame in pixels.
        :param step: step size in s; it replaces that of the file.
        :raises MechanismError: with all problems of the file.
        :raises ValueError: an unknown coordinate or render mode, or an effort without a limit.
        """
        record = mechanism if isinstance(mechanism, Mechanism) else load_mechanism(mechanism)
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"there is no render mode '{render_mode}'. Use 'rgb_array' or None.")
        if frame_skip < 1:
            raise ValueError(f"frame_skip must be 1 or more, not {frame_skip}")
        self.simulation = Simulation(record, step=step)
        self.reward, self.terminated = reward, terminated
        self.frame_skip, self.horizon, self.start_noise = frame_skip, horizon, start_noise
        self.start = dict(start or {})
        self.render_mode, self._render_size = render_mode, render_size
        self._animation: Animation | None = None
        self.metadata = self.metadata | {"render_fps": round(1.0 / (frame_skip * self.simulation.step_size))}
        self.actuated = tuple(record.coordinate_names if actuated is None else actuated)
        limits = self._limits(effort_limits or {}).astype(np.float32)
        self._indices = [record.coordinate_names.index(name) for name in self.actuated]
        self._efforts = np.zeros(self.simulation.u.size)
        self._angles = _angles(record, self.simulation) if trigonometric else np.zeros(self.simulation.q.size, bool)
        self._actions = 0
        self.action_space = spaces.Box(-limits, limits, dtype=np.float32)
        turning = np.count_nonzero(self._angles)
        bounds = np.full(self._observation().size, np.inf)
        bounds[self._angles.size - turning : self._angles.size + turning] = 1.0
        self.observation_space = spaces.Box(-bounds, bounds, dtype=np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Return to the start, or to the `options` "q" and "u", with noise; loops stay closed.

        :raises ValueError: see `Simulation.reset`.
        """
        super().reset(seed=seed)
        sim, given = self.simulation, self.start | (options or {})
        self._actions = 0
        if not given and not self.start_noise:
            sim.reset()
            return self._observation(), {}
        file, model = sim.model.start, sim.model
        q = np.array(given.get("q", file[model.q_range]), dtype=float)
        u = np.array(given.get("u", file[model.u_range]), dtype=float)
        q += self.np_random.uniform(-self.start_noise, self.start_noise, q.shape)
        u += self.np_random.uniform(-self.start_noise, self.start_noise, u.shape)
        sim.reset(q, u)
        return self._observation(), {}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply the efforts for `frame_skip` steps.

        :param action: (actuated,) in N or N·m, clipped to the limits.

        :raises CommandError: the action has another shape, or a value that is not finite.
        """
        values = np.asarray(action, dtype=float)
        if values.shape != (len(self.actuated),):
            raise CommandError(
                f"the action has the shape {values.shape}. Give one effort for each of: {listed(self.actuated)}."
            )
        self._efforts[self._indices] = np.clip(values, self.action_space.low, self.action_space.high)
        self.simulation.set_efforts(self._efforts)
        info: dict[str, Any] = {}
        try:
            self.simulation.step(self.frame_skip)
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
            from mbd_sim.drawing.animation import Animation

            self._animation = Animation(self.simulation.model, *self._render_size)
        return self._animation.frame(self.simulation.poses())

    def _observation(self) -> Observation:
        q, u, angles = self.simulation.q, self.simulation.u, self._angles
        return np.concatenate([q[~angles], np.cos(q[angles]), np.sin(q[angles]), u])

    def _limits(self, given: Mapping[str, float]) -> Array:
        """The effort limits of the actuated coordinates; the given ones are also set in the simulation."""
        names = self.simulation.coordinate_names
        for name in (*self.actuated, *given):
            if name not in names:
                raise ValueError(f"there is no coordinate '{name}'. {nearest(name, names)}")
        limits = self.simulation.effort_map.limits
        for name, limit in given.items():
            limits[names.index(name)] = limit
        found = np.array([limits[names.index(name)] for name in self.actuated])
        if unlimited := [name for name, limit in zip(self.actuated, found, strict=True) if not np.isfinite(limit)]:
            raise ValueError(
                f"the effort of {listed(unlimited)} has no limit. Give joints an 'effort_limit', or the environment "
                f"'effort_limits'."
            )
        return found


def _angles(mechanism: Mechanism, simulation: Simulation) -> NDArray[np.bool_]:
    """Which of the coordinates q (nq,) are angles."""
    angles = np.zeros(simulation.q.size, dtype=bool)
    for name, joint in mechanism.joints.items():
        if not joint.drive and joint.kind.quaternion is None:
            angles[simulation.model.layout.q[name]] = [coordinate.rotation for coordinate in joint.kind.coordinates]
    return angles
