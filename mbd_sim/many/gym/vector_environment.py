"""Many copies of a mechanism as one vectorized Gymnasium environment: an ensemble, advanced in vectors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.gym.agent_interface import AgentInterface, Limit, require_episodes, require_starts, with_limits
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.ensemble.ensemble import Ensemble
from mbd_sim.simulation.ensemble.members import sampling_steps, time_dependence
from mbd_sim.simulation.ensemble.variants import Change
from mbd_sim.simulation.run.arguments import rows_of

Flags = NDArray[np.bool_]
Infos = dict[str, Any]


class MechanismVectorEnv(VectorEnv[Array, NDArray[np.float32], Array]):  # type: ignore[misc]  # mypy skips Gymnasium
    """`MechanismEnv` many times over: with the same seeds and actions, each environment gets the same bits as alone.

    `reward` and `terminated` receive the `Ensemble` after the actions, and return arrays (k,). The environments can
    have values of their own, for domain randomization. Environments whose episode has ended start again by
    themselves, as `autoreset_mode` says. One whose state becomes infinite ends its episode, with `infos["diverged"]`.

    >>> envs = MechanismVectorEnv(
    ...     "double_pendulum", 1000, ["elbow"], reward=lambda members, actions: -abs(members.q[:, 0])
    ... )
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  # Gymnasium's own way

    __repr__ = short_repr

    def __init__(
        self,
        mechanism: str | Path | Mechanism,
        num_envs: int | Sequence[Change],
        actuated: Sequence[str] | None = None,
        *,
        reward: Callable[[Ensemble, NDArray[np.float32]], Array],
        terminated: Callable[[Ensemble], Flags] | None = None,
        effort_limits: Mapping[str, float] | None = None,
        command_limits: Mapping[str, Limit] | None = None,
        start: Mapping[str, Sequence[float]] | None = None,
        start_noise: float = 0.0,
        trigonometric: bool = True,
        frame_skip: int = 20,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        step: float | None = None,
        threads: int | None = None,
    ) -> None:
        """Build and compile the mechanism; for what is not listed here see `MechanismEnv`.

        :param num_envs: the number k of environments, or the values of the file that each one changes, by key, as for
            `Ensemble`; they stay the same in all episodes.
        :param reward: called with the ensemble and the actions (k, actuated) that have just been applied.
        :param terminated: called with the ensemble; which episodes end. None do by default.
        :param max_episode_steps: actions after which an episode is truncated; never, if None.
        :param threads: see `Ensemble`.
        :raises MechanismError: with all problems of the file.
        :raises ValueError: an unknown coordinate or mode, an effort without a limit, a number that cannot be used, or a
            motion that depends on the time.
        """
        record = mechanism if isinstance(mechanism, Mechanism) else load_mechanism(mechanism)
        require_episodes(start, start_noise, frame_skip, max_episode_steps)
        self.ensemble = Ensemble(record, num_envs, step=step, threads=threads)
        _require_independent(self.ensemble, frame_skip)
        limits = with_limits(record.coordinate_names, self.ensemble.effort_limits, effort_limits or {})
        self.ensemble.set_effort_limits(limits)
        self._agent = AgentInterface(
            record, self.ensemble.model, limits.max(axis=0), actuated, trigonometric, command_limits
        )
        self.num_envs, self.actuated = len(self.ensemble), self._agent.actuated
        self.single_action_space, self.single_observation_space = (
            self._agent.action_space,
            self._agent.observation_space,
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.reward, self.terminated = reward, terminated
        self.start, self.start_noise = dict(start or {}), start_noise
        self.frame_skip, self.max_episode_steps = frame_skip, max_episode_steps
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = self.metadata | {
            "autoreset_mode": self.autoreset_mode,
            "render_fps": round(1.0 / (frame_skip * self.ensemble.step_size)),
        }
        self._generators: list[np.random.Generator] = []
        self._actions = np.zeros(self.num_envs, dtype=np.int64)
        self._ended = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Begin an episode in every environment, or in those of the `options` "reset_mask" (k,).

        :param seed: of the first environment, the next one has the next seed; or one for each.
        :param options: "q" and "u" at the start, one row or (k, n), in place of those of the file.
        :raises ValueError: see `Ensemble.reset`; or the number of seeds, or the mask, does not fit; or another option.
        """
        require_starts(options or {}, ["reset_mask"])
        given = self.start | (options or {})
        mask = np.asarray(given.pop("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise InputError(f"reset_mask is {mask.dtype} {mask.shape}", "Give one True or False for each environment.")
        self._seed(seed)
        self._begin(np.flatnonzero(mask), given)
        self._ended[mask] = False
        return self._observations(), {}

    def step(self, actions: NDArray[np.float32]) -> tuple[Array, Array, Flags, Flags, Infos]:
        """Apply the efforts and commands for `frame_skip` steps.

        :param actions: (k, actuated) in N or N·m or the units of channels, clipped to the limits.
        :raises CommandError: the actions have another shape, or a value that is not finite.
        :raises ValueError: `reward` or `terminated` do not return one value for each environment.
        """
        members = self.ensemble
        members.set_efforts(self._agent.efforts(actions, (self.num_envs,)))
        if self._agent.has_commands:
            members.set_commands(self._agent.commands(actions, members.commands))
        members.step(self.frame_skip)
        self._actions += 1
        rewards = self._one_each("reward", self.reward(members, np.asarray(actions)), float)
        lost = ~members.alive
        terminated = lost.copy()
        if self.terminated is not None:
            terminated |= self._one_each("terminated", self.terminated(members), bool)
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self.max_episode_steps is not None:
            truncated |= self._actions >= self.max_episode_steps
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._ended.any():
            again = np.flatnonzero(self._ended)
            self._begin(again, self.start)
            rewards[again], terminated[again], truncated[again], lost[again] = 0.0, False, False, False
        infos: Infos = {"diverged": lost, "_diverged": lost} if lost.any() else {}
        self._ended = terminated | truncated
        observations = self._observations()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            again = np.flatnonzero(self._ended)
            infos |= _final(observations, self._ended)
            self._begin(again, self.start)
            observations = self._observations()
        return observations, rewards, terminated, truncated, infos

    @property
    def episode_times(self) -> Array:
        """The time (k,) in s since each episode began."""
        return self._actions.astype(float) * (self.frame_skip * self.ensemble.step_size)

    def _begin(self, members: NDArray[np.intp], given: Mapping[str, Any]) -> None:
        """Begin an episode in some environments, from the file's start or the given one, with noise."""
        self._actions[members] = 0
        if not given and not self.start_noise:
            self.ensemble.restart(members)
            return
        model, states = self.ensemble.model, self.ensemble.start_states
        coordinates = [("q", states[:, model.q_range]), ("u", states[:, model.u_range])]
        starts = [rows_of(given.get(name, file), file.shape, name)[members].copy() for name, file in coordinates]
        if self.start_noise and "u" in given:
            self.ensemble.restart(members, *starts)  # refuses speeds that violate the constraints; noise may
        if not self._generators:
            self._seed(None)
        for row, member in enumerate(members.tolist()):
            for start in starts:
                noise = self._generators[member].uniform(-self.start_noise, self.start_noise, start.shape[1])
                start[row] += noise
        self.ensemble.restart(members, *starts, nearest_speeds=bool(self.start_noise) or "u" not in given)

    def _seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Seed the environments; None leaves a generator as it is, or seeds it at random for the first time."""
        seeds = [seed + member for member in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is None:
            seeds = [None] * self.num_envs
        if len(seeds) != self.num_envs:
            raise InputError(f"{len(seeds)} seeds for {self.num_envs} environments", "Give one for each.")
        for member, one in enumerate(seeds):
            if member == len(self._generators):
                self._generators.append(seeding.np_random(one)[0])
            elif one is not None:
                self._generators[member] = seeding.np_random(one)[0]

    def _observations(self) -> Array:
        return self._agent.observations(np.asarray(self.ensemble.q), np.asarray(self.ensemble.u))

    def _one_each(self, name: str, values: Any, kind: type) -> NDArray[Any]:
        found: NDArray[Any] = np.array(values, dtype=kind)
        if found.shape != (self.num_envs,):
            raise InputError(
                f"{name} returned the shape {found.shape} for {self.num_envs} environments",
                "Compute it from arrays, such as members.q[:, 0].",
            )
        return found


def _final(observations: Array, ended: Flags) -> Infos:
    """The last observations of episodes that have ended, as Gymnasium's own vectors report them."""
    last = np.full(len(ended), None, dtype=object)
    for member in np.flatnonzero(ended).tolist():
        last[member] = observations[member]
    return {"final_obs": last, "_final_obs": ended.copy()}


def _require_independent(members: Ensemble, frame_skip: int) -> None:
    """Refuse mechanisms whose members cannot start again by themselves after any number of actions.

    :raises ValueError: the motion depends on the time, or sampled servos do not sample at each action.
    """
    reason, every = time_dependence(members.model), sampling_steps(members.model)
    if reason is None and frame_skip % every:
        reason = f"servos sample at every multiple of {every} steps, and frame_skip is {frame_skip}"
    if reason is not None:
        raise InputError(
            f"these environments cannot start their episodes independently, because {reason}",
            "Use gymnasium.make_vec(…, vectorization_mode='sync').",
        )
