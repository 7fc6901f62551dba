"""Tracking environment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, frozen_array, numbers, positive_per_joint
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.gains.gains import torque_limits as own_limits
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs.random_reference import Trajectory, drawn
from adaptctl.envs.task import (
    LOOK_AHEAD,
    Judgement,
    RewardWeights,
    RunningEpisode,
    control_period_of,
    finite_numbers,
    initial_error_of,
    known_options,
    steps_of,
    times_ahead_of,
    validate_reference,
    weights_of,
)
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation import Integrator, Plant, PlantState, RungeKutta4
from adaptctl.simulation.closed_loop import Episode
from adaptctl.simulation.effects import Effect, Payload, PlantEffects
from adaptctl.simulation.effects.plant_effects import listed
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.plant import validate_ten_a_link
from adaptctl.simulation.reference_limits import warn_of_limits
from adaptctl.simulation.references import Preview, warn_of_derivatives
from adaptctl.simulation.transmission import Transmission

if TYPE_CHECKING:
    from adaptctl.description.visual import Visual
    from adaptctl.envs.rendering import Renderer
    from adaptctl.recording.live import Live

MAX_OBSERVATION = 1e6
"""Bound of observations, which Gymnasium wants finite."""

OPTIONS = ("payload", "trajectory", "initial_error", "parameters")


@sent_as_made
class TrackingEnv(gymnasium.Env[Array, Array]):
    """
    Tracking task: joint torques drive a robot of r joints along a reference trajectory.

    Parameters
    ----------
    robot : str, Path or Mechanism, default "puma560_measured"
        Built-in's name, file (``.urdf``, ``.xml``, ``.toml``) or mechanism. The default is a measured arm, physically
        consistent.
    reference : Reference, int, "random" or None, default None
        Trajectory, or the seed of a random one; None or "random" for a new one at each reset: a sinusoid for each joint
        of 0.1 to 0.25 Hz and up to 0.5 rad (m), faded in over 2 s, within the limits. Wrong derivatives,
        and positions or speeds beyond limits, warn (`ReferenceWarning`).
    duration : float, default 20.0
        Length of an episode in s. 20 s are two periods of the slowest sinusoid of random references.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    substeps : int, optional
        Integration steps per control period. Default: as many as friction needs, else 1.
    integrator : Integrator, optional
        Integration method. Default: `RungeKutta4`, or `LinearlyImplicitEuler` where friction is stiff.
    look_ahead : sequence of float, default (0.05, 0.2)
        Times (L,) in s at which the reference ahead is observed; may be empty.
    error_bound : array_like, default 1.0
        Error in rad (m), one number or (r,), beyond which an episode ends; infinity for never.
    reward_weights : RewardWeights, optional
        Weights of the reward. Default: `RewardWeights()`.
    initial_error : array_like, default 0.0
        Error of the positions at the start in rad (m), one number or (r,). Zero starts on the reference.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Default: see the action space.
    effects : iterable of Effect, default ()
        Delays, limits, friction, sensors and loads of `adaptctl.simulation.effects`, in any order. Default: none, an
        ideal robot.
    render_mode : {"human", "rgb_array"}, optional
        "human" shows each step in the rerun viewer on this computer, "rgb_array" has `render` return images. Default:
        neither.

    Raises
    ------
    InputError
        If a value is out of range or the reference has another number of joints.
    NonFiniteError
        If `error_bound` is NaN or `initial_error` is not finite.
    NotFoundError
        If there is no such built-in or mode.
    FileError
        If the robot's file cannot be read.

    Notes
    -----
    The plant is rigid links with rotors and friction, without joint stops. Units in brackets hold for prismatic joints.

    ## Action space

    `Box(-limit, limit, (r,), float64)`: torques in N m (N), clipped to the limits. A joint without a limit gets four
    times its largest inverse-dynamics torque in 200 random states up to 2 rad/s and 10 rad/s^2, at least 1 N m (N).

    ## Observation space

    `Box(-1e6, 1e6, (5r + r L,), float64)` for L look-ahead times; `observation_slices` has the slices by name.

    - `p`, `v`: measured positions in rad (m) and velocities in rad/s (m/s)
    - `reference_p`, `reference_v`, `reference_a`: the reference now, accelerations in rad/s^2 (m/s^2)
    - `look_ahead`: reference positions at each time ahead in turn

    ## Reward

    *-(position sum(e^2) + velocity sum(e'^2) + torque sum((applied torque / limit)^2))* with the true errors
    e = p - reference p after the step and the `RewardWeights`, less `termination` at termination.

    ## Starting state

    At the reference's position and velocity, with `initial_error` added to the position.

    ## Episode end

    Terminated when |e| passes `error_bound`, positions break a condition of the robot's file, or a loop nears a
    singularity (smallest singular value of its Jacobian below 0.05 of the reference value). Truncated at `duration`.

    ## Information

    - `time`: s since the reset
    - `parameters`: (P,) true inertial and friction parameters with the payload, SI units, in the order of
      `mechanism.parameter_names`
    - `applied_torque`: (r,) torque at the joints in the last step, N m (N)
    - `energy`: kinetic plus potential energy, J
    - `clipped`: number of clipped actions since the reset

    With effects also:

    - `p`, `v`: true positions and velocities (r,)
    - `flags`: `payload` (kg held), `torque_limited` and `rate_limited` (1 or 0) in the last step

    ## Options at reset

    Equal seeds, options and actions give equal episodes, bit for bit.

    - `payload`: `Payload` on the last link with mass, point mass in kg at its origin, or mapping of `mass`, `center`
      (3,) in m and `inertia` (3, 3) in kg m^2 about the center
    - `trajectory`: `Reference`, seed of a random one, or `"random"`
    - `initial_error`: rad (m), one number or (r,)
    - `parameters`: (P,) true parameters, without the payload

    Examples
    --------
    >>> import gymnasium
    >>> env = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, reference=reference, duration=0.1)
    >>> observation, info = env.reset(seed=0, options={"payload": 0.2})
    >>> observation, reward, terminated, truncated, info = env.step([1.0, 0.5])
    >>> observation.shape, round(info["time"], 3)
    ((14,), 0.001)
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 1000.0}  # noqa: RUF012  # Gymnasium's way

    surroundings: tuple[Visual, ...] = ()

    def __init__(
        self,
        robot: str | Path | Mechanism = "puma560_measured",
        reference: Trajectory = None,
        *,
        duration: float = 20.0,
        control_period: float = 1e-3,
        substeps: int | None = None,
        integrator: Integrator | None = None,
        look_ahead: Sequence[float] = LOOK_AHEAD,
        error_bound: ArrayLike = 1.0,
        reward_weights: RewardWeights | None = None,
        initial_error: ArrayLike = 0.0,
        torque_limits: ArrayLike | None = None,
        effects: Iterable[Effect] = (),
        render_mode: str | None = None,
    ) -> None:
        mechanism = robot if isinstance(robot, Mechanism) else load(robot)
        limits, period = own_limits(mechanism, torque_limits, finite=True), control_period_of(control_period)
        placed = PlantEffects.of(effects := listed(effects))
        placed.validate(mechanism.dof, mechanism.description.body_names, period)
        springs = None if placed.elastic is None else Transmission.of(mechanism, placed.elastic)
        if substeps is None:
            substeps, integrator = integration(mechanism, placed.joints, period, integrator, springs)
        plant = Plant(mechanism, period, substeps, integrator or RungeKutta4(), limits, effects=effects)
        self._set_task(plant, reference, duration, look_ahead, error_bound, reward_weights, initial_error, render_mode)

    def _set_task(
        self,
        plant: Plant,
        reference: Trajectory,
        duration: float,
        look_ahead: Sequence[float],
        error_bound: ArrayLike,
        reward_weights: RewardWeights | None,
        initial_error: ArrayLike,
        render_mode: str | None,
    ) -> None:
        self.plant, self.mechanism, self.control_period = plant, plant.mechanism, plant.control_period
        self.steps = steps_of(duration, self.control_period)
        self.look_ahead = times_ahead_of(look_ahead)
        self.error_bound = positive_per_joint(error_bound, self.mechanism.dof, "error_bound", infinite=True)
        self.reward_weights = weights_of(reward_weights)
        self.initial_error = initial_error_of(initial_error, self.mechanism.dof)
        validate_reference(reference, self.mechanism.dof)
        self.trajectory = reference
        if callable(reference):
            joints = self.mechanism.primary_joints
            warn_of_derivatives(reference, [joint.name for joint in joints], duration)
            warn_of_limits(reference, joints, duration)
        self._set_spaces()
        self._set_render_mode(render_mode)
        self._episode: RunningEpisode | None = None
        self._renderer: Renderer | None = None
        self._live: Live | None = None

    @property
    def reference(self) -> Reference:
        """Reference of the running episode."""
        return self._running("reference").preview.reference

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """
        Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the random numbers. Default: the generator goes on from the last episode.
        options : dict, optional
            Options at reset, see the class. Default: none.

        Returns
        -------
        tuple
            First observation (5r + r L,) for L look-ahead times, and `info`, see the class.

        Raises
        ------
        InputError
            If an option is bad.
        NotFoundError
            If an option is unknown.
        NonFiniteError
            If an option is not finite.
        SingularityError
            If loops cannot be followed to the start.

        Examples
        --------
        >>> from adaptctl.envs import TrackingEnv
        >>> env = TrackingEnv(arm, reference, duration=0.1)
        >>> observation, info = env.reset(seed=0, options={"initial_error": 0.05})
        >>> observation.shape
        (14,)
        """
        started = self._started(seed, options)
        self.plant.compile()
        self._show(started, np.zeros(self.plant.dof))
        return self._observation(started), self._info(started.parameters, started.state, 0, 0)

    def _started(self, seed: int | None, options: dict[str, Any] | None) -> RunningEpisode:
        super().reset(seed=seed)
        given, r = known_options(options, OPTIONS), self.plant.dof
        error = initial_error_of(given.get("initial_error", self.initial_error), r)
        parameters = self.true_parameters(given)
        reference = drawn(given.get("trajectory", self.trajectory), self.mechanism, self.np_random)
        preview = Preview(reference, r, self.control_period, self.look_ahead)
        start = preview.row(0)
        state = self.plant.init(start[:r] + error, start[r : 2 * r], self._now(parameters, 0), self._noise())
        self._episode = RunningEpisode(parameters, preview, state)
        return self._episode

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """
        Advance the episode by a control period.

        Parameters
        ----------
        action : array_like
            Torque (r,) in N m (N if prismatic), clipped to the limits and held.

        Returns
        -------
        tuple
            Observation (5r + r L,) for L look-ahead times, reward, `terminated`, `truncated` and `info`, see the class.

        Raises
        ------
        InputError
            If the shape is wrong.
        NonFiniteError
            If the action or the motion is NaN or infinite.
        gymnasium.error.ResetNeeded
            If no episode is running.
        """
        episode = self._running("step")
        if episode.over:
            raise ResetNeeded("the episode is over: call env.reset() before the next env.step(action)")
        torque = self._torque(action)
        parameters = self._now(episode.parameters, episode.step)
        episode.state = state = self.plant.step(episode.state, torque, parameters, self._noise())
        episode.step += 1
        episode.clipped += state.clipped
        rewards, over = self._judged(state.q, state.v, self._reference(episode), state.applied_torque)
        reward, terminated, truncated = float(rewards), bool(over), episode.step >= self.steps
        episode.over = terminated or truncated
        self._show(episode, state.applied_torque)
        info = self._info(episode.parameters, state, episode.step, episode.clipped)
        return self._observation(episode), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """
        Draw the robot and a translucent copy of it at its reference position.

        Returns
        -------
        ndarray or None
            RGB image (480, 640, 3), uint8; None in the mode "human", where `step` shows the robot; None without a mode,
            with a warning of Gymnasium.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If there was no reset.
        """
        episode = self._running("render")
        if self.render_mode is None:
            gymnasium.logger.warn("render: set a mode when creating the environment: render_mode='rgb_array'")
        if self.render_mode != "rgb_array":
            return None
        if self._renderer is None:
            from adaptctl.envs.rendering import Renderer

            self._renderer = Renderer(self.mechanism, surroundings=self.surroundings)
        goal = episode.preview.row(episode.step)[: self.plant.dof]
        return self._renderer.image(episode.state.p, goal, episode.step * self.control_period)

    def close(self) -> None:
        """End the live view of the mode "human", when its samples are drawn."""
        if self._live is not None:
            self._live.close()
            self._live = None

    def _show(self, episode: RunningEpisode, torque: Array) -> None:
        """Show a step live in the mode "human"."""
        if self.render_mode != "human":
            return
        if self._live is None:
            from adaptctl.recording.live import CURRENT, Live

            self._live = Live(self.mechanism, CURRENT.get(), surroundings=self.surroundings)
        goal = episode.preview.row(episode.step)[: self.plant.dof]
        self._live.show(episode.step * self.control_period, episode.state.p, goal, torque)

    def episode(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Episode:
        """
        Begin a new episode that `simulate` runs in native code.

        Parameters
        ----------
        seed : int, optional
            Seed of all random numbers of the episode. By default the generator goes on from the last episode.
        options : dict, optional
            Payload, trajectory and other options of the episode, the same as for `reset`.

        Returns
        -------
        Episode
            The episode; the environment takes no step before the next `reset`.

        Raises
        ------
        NotImplementedError
            If a subclass has a `step` of its own: it then has to write this method too. Errors of `reset` are raised as
            there.

        Examples
        --------
        >>> env.episode(seed=0).steps
        200
        """
        if type(self).step is not TrackingEnv.step:
            raise NotImplementedError(f"{type(self).__name__} has a custom step")
        if type(self).reset is TrackingEnv.reset:
            started = self._started(seed, options)  # what a step needs is not compiled
        else:
            self.reset(seed=seed, options=options)
            started = self._running("episode")
        started.over, reference = True, started.preview.reference
        told = self._judged, self._info
        return Episode(self.plant, started.state, started.parameters, reference, self.np_random, self.steps, *told)

    def _judged(self, q: Array, v: Array, reference: ReferencePoint, applied: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Rewards (...), and whether the episode ends."""
        judged = self.judgement.kernel if q.ndim == 1 else self.judgement.kernel.map
        reward, lost = judged(self.plant.positions(q), v, reference.p, reference.v, applied)
        terminated = ~self.plant.is_valid_configuration(q) | (np.asarray(lost) > 0.0)
        return reward - self.reward_weights.termination * terminated, terminated

    @cached_property
    def judgement(self) -> Judgement:
        """Function that computes rewards and terminations."""
        return Judgement(self.reward_weights, self.error_bound, self._limits)

    def _reference(self, episode: RunningEpisode) -> ReferencePoint:
        row, r = episode.preview.row(episode.step), self.plant.dof
        return ReferencePoint(row[:r], row[r : 2 * r], row[2 * r : 3 * r])

    def _observation(self, episode: RunningEpisode) -> Array:
        return np.concatenate((episode.state.measured_p, episode.state.measured_v, episode.preview.row(episode.step)))

    def _info(
        self, own: Array, state: PlantState, steps: int, clipped: int, energy: float | None = None
    ) -> dict[str, Any]:
        parameters, time = self._now(own, steps), steps * self.control_period
        info: dict[str, Any] = {
            "time": time,
            "parameters": parameters.copy(),  # Gymnasium: what is returned is the caller's to change
            "applied_torque": state.applied_torque if steps else np.zeros(self.plant.dof),
            "energy": self.plant.energy(state, parameters) if energy is None else energy,
            "clipped": clipped,
        }
        if self.plant.flags or self.plant.effects:
            flags = dict(zip(self.plant.flags, state.flags.tolist(), strict=True))
            if self.plant.loads:
                flags["payload"] = self.plant.payload_mass(time)
            info |= {"p": state.p.copy(), "v": state.v.copy(), "flags": flags}
        return info

    def _now(self, parameters: Array, step: int) -> Array:
        """True parameters at a step, with payloads."""
        if not self.plant.loads:
            return parameters
        return self.plant.parameters(parameters, step * self.control_period)

    def _noise(self) -> Array | None:
        size = self.plant.noise_size
        return self.np_random.standard_normal(size) if size else None

    def _torque(self, action: ArrayLike) -> Array:
        torque = numbers(action, "action")
        if torque.shape != (self.plant.dof,):
            raise InputError(f"action: expected shape ({self.plant.dof},), got {torque.shape}")
        return torque

    def true_parameters(self, options: Mapping[str, Any]) -> Array:
        """
        Return the true parameters of an episode.

        Parameters
        ----------
        options : Mapping
            Options at reset, of which `parameters` and `payload` count.

        Returns
        -------
        ndarray
            Inertial and friction parameters (P,), SI units, ordered as `Mechanism.parameter_names`.

        Raises
        ------
        InputError
            If a shape is wrong, no rigid body is described, or the mechanism has relations among its inertial
            parameters.
        NonFiniteError
            If a parameter is not finite.
        """
        own = finite_numbers(options.get("parameters", self.mechanism.inertial_parameters), "parameters")
        parameters = frozen_array(own, self.mechanism.inertial_parameters.shape, "parameters")
        if "payload" in options:
            validate_ten_a_link(self.mechanism)
            return Payload.of(options["payload"]).added_to(parameters, len(self.mechanism.description.bodies) - 1)
        return parameters

    def _running(self, what: str) -> RunningEpisode:
        if self._episode is None:
            raise ResetNeeded(f"{what}: no episode has started: call env.reset() first")
        return self._episode

    def _set_spaces(self) -> None:
        r, ahead = self.plant.dof, self.plant.dof * len(self.look_ahead)
        names = ("p", "v", "reference_p", "reference_v", "reference_a")
        slices = {name: slice(i * r, (i + 1) * r) for i, name in enumerate(names)}
        self.observation_slices = MappingProxyType(slices | {"look_ahead": slice(5 * r, 5 * r + ahead)})
        self._limits = np.asarray(self.plant.torque_limits)
        if not np.isfinite(self._limits).all():
            raise InputError(f"torque_limits: actions need finite limits, got {self._limits.tolist()}")
        self.action_space = gymnasium.spaces.Box(-self._limits, self._limits, dtype=np.float64)
        shape = (5 * r + ahead,)
        self.observation_space = gymnasium.spaces.Box(-MAX_OBSERVATION, MAX_OBSERVATION, shape, np.float64)

    def _set_render_mode(self, render_mode: str | None) -> None:
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise NotFoundError(f"unknown render mode {render_mode!r}; modes: {', '.join(modes)}")
        self.render_mode = render_mode
        self.metadata = self.metadata | {"render_fps": 1.0 / self.control_period}
