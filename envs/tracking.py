"""The tracking environment for any mechanism."""

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
from adaptctl.simulation.references import Preview, warn_of_derivatives
from adaptctl.simulation.transmission import Transmission

if TYPE_CHECKING:
    from adaptctl.envs.rendering import Renderer

LARGEST_OBSERVATION = 1e6
"""Bound of every observation in its own unit: check_env wants a finite one, and no motion comes near it."""

OPTIONS = ("payload", "trajectory", "initial_error", "parameters")


@sent_as_made
class TrackingEnv(gymnasium.Env[Array, Array]):
    """
    ## Description

    A tracking environment: a mechanism of r joints, driven by joint torques, is to follow a reference trajectory in
    joint space. The physics are the equations of motion of rigid links, with the rotors and the friction that the
    mechanism's drives have, without joint stops, integrated under a torque that is held over each control period. What
    real plants have besides, such as delay, encoders or a payload that is dropped, is switched on by `effects`.

    ```python
    env = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot="my_arm.urdf")
    ```

    ## Action space

    `Box(-limit, limit, (r,), float64)`: the torque of every joint in N m (the force in N of a prismatic one). The
    limits are the mechanism's own. A joint without one gets four times the largest torque that inverse dynamics asks of
    it in 200 random states at up to 2 rad/s and 10 rad/s^2 (m/s, m/s^2), and at least 1. What is out of bounds is
    clipped and counted; NaN and infinity raise `NonFiniteError`, a wrong shape `InputError`.

    ## Observation space

    `Box(-1e6, 1e6, (5r + r L,), float64)` for L look-ahead times. `observation_slices` maps the names below to slices
    of it. Here and below, units in brackets are those of prismatic joints.

    | Slice         | Size | Observation                                                | Unit               |
    |---------------|------|------------------------------------------------------------|--------------------|
    | `p`           | r    | positions, as measured                                     | rad (m)            |
    | `v`           | r    | velocities, as measured                                    | rad/s (m/s)        |
    | `reference_p` | r    | the reference's positions now                              | rad (m)            |
    | `reference_v` | r    | the reference's velocities now                             | rad/s (m/s)        |
    | `reference_a` | r    | the reference's accelerations now                          | rad/s^2 (m/s^2)    |
    | `look_ahead`  | r L  | the reference's positions at each time ahead, in turn      | rad (m)            |

    ## Reward

    *reward = -(position sum(e^2) + velocity sum(e'^2) + torque sum((applied torque / limit)^2))*, no unit, with the
    true errors e = p - reference p and e' = v - reference v after the step, and with `RewardWeights(position=1,
    velocity=0.1, torque=0.001, termination=1000)`. `termination` is subtracted once when an episode is terminated.

    ## Starting state

    On the reference at time zero, at its speed, `initial_error` off in every joint.

    ## Episode end

    Terminated when a joint's |e| passes `error_bound` (1 rad or m; infinity for never), when a mechanism with loops
    nears a singularity, or when positions break a condition that its file states. Truncated at `duration`.

    ## Information

    | Key              | Value                                                                      |
    |------------------|----------------------------------------------------------------------------|
    | `time`           | s since the reset                                                          |
    | `parameters`     | (P,) the true inertial and friction parameters now, SI units, payload included, in the order of `mechanism.parameter_names` |
    | `applied_torque` | (r,) the torque that reached the joints in the last step, N m (N)          |
    | `energy`         | kinetic plus potential energy in J                                         |
    | `clipped`        | how many steps since the reset had an action clipped                       |
    | `p`, `v`         | with effects: (r,) true positions, rad (m), and velocities, rad/s (m/s)    |
    | `flags`          | with effects: what happened in the last step, by name: `payload` (kg held), `torque_limited`, `rate_limited` (1 or 0) |

    ## Arguments

    | Argument         | Default              | Meaning                                                        |
    |------------------|----------------------|----------------------------------------------------------------|
    | `robot`          | `"puma560_measured"` | a built-in's name, a file (`.urdf`, `.xml`, `.toml`), or a `Mechanism` |
    | `reference`      | `None`               | a `Reference`, the seed of a random one (at least 0), or `None` or `"random"` for a new one at each reset: one sinusoid a joint of 0.1 to 0.25 Hz and up to 0.5 rad (m), faded in over 2 s, within the position and velocity limits. Warns (`ReferenceWarning`) where velocities or accelerations of a `Reference` are no derivatives |
    | `duration`       | 20.0                 | length of an episode, s                                        |
    | `control_period` | 0.001                | time for which a torque is held, s                             |
    | `substeps`       | `None`               | integration steps a control period; `None` for as many as friction needs, else 1 |
    | `integrator`     | `None`               | `None` for `RungeKutta4()`, or `LinearlyImplicitEuler()` where friction is stiff |
    | `look_ahead`     | (0.05, 0.2)          | (L,), times ahead, s, at least 0 each; may be empty             |
    | `error_bound`    | 1.0                  | error beyond which an episode ends, rad (m), one positive number or one a joint; NaN raises `NonFiniteError`, here and below |
    | `reward_weights` | `RewardWeights()`    | the weights of the reward above                                |
    | `initial_error`  | 0.0                  | of the positions at the start, rad (m), one number or one a joint |
    | `torque_limits`  | `None`               | N m (N), one number or one a joint; `None` for those of the action space above |
    | `effects`        | ()                   | those of real plants, from `adaptctl.simulation.effects`, in any order; () for none |
    | `render_mode`    | `None`               | or `"rgb_array"`; `None` for no images                         |

    Raises `InputError` for bad values, a `Reference` of another number of joints among them, of these `NonFiniteError`
    for an `initial_error` that is not finite, `NotFoundError` for an unknown built-in or mode, `FileError` for a bad
    file.

    ## Options at reset

    For the episode that begins, else as constructed. Equal seeds, options and actions give equal episodes, bit for bit.

    | Option          | Value                                                                                 |
    |-----------------|---------------------------------------------------------------------------------------|
    | `payload`       | a point mass in kg at the origin of the frame of the last link that has mass, a `Payload`, or a mapping with `mass`, `center` (3,), m, in that link's frame and `inertia` (3, 3), kg m^2, about that centre |
    | `trajectory`    | a `Reference`, the seed of a random one, or `"random"`                                |
    | `initial_error` | rad (m), one number or one a joint                                                    |
    | `parameters`    | (P,) true inertial and friction parameters, SI units, in the order of `mechanism.parameter_names`, to which the payload is added |

    ## Version history

    * v0: first version
    """  # noqa: E501  # tables

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1000.0}  # noqa: RUF012  # Gymnasium's way

    def __init__(
        self,
        robot: str | Path | Mechanism = "puma560_measured",
        reference: Trajectory = None,
        *,
        duration: float = 20.0,
        control_period: float = 1e-3,
        substeps: int | None = None,
        integrator: Integrator | None = None,
        look_ahead: Sequence[float] = (0.05, 0.2),
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
        reference: Trajectory = None,
        duration: float = 20.0,
        look_ahead: Sequence[float] = (0.05, 0.2),
        error_bound: ArrayLike = 1.0,
        reward_weights: RewardWeights | None = None,
        initial_error: ArrayLike = 0.0,
        render_mode: str | None = None,
    ) -> None:
        """Set the plant, the reference and the rules of an episode."""
        self.plant, self.mechanism, self.control_period = plant, plant.mechanism, plant.control_period
        self.steps = steps_of(duration, self.control_period)
        self.look_ahead = times_ahead_of(look_ahead)
        self.error_bound = positive_per_joint(error_bound, self.mechanism.dof, "error_bound", infinite=True)
        self.reward_weights = weights_of(reward_weights)
        self.initial_error = initial_error_of(initial_error, self.mechanism.dof)
        validate_reference(reference, self.mechanism.dof)
        self.trajectory = reference
        if callable(reference):
            warn_of_derivatives(reference, [joint.name for joint in self.mechanism.primary_joints], duration, 4)
        self._set_spaces()
        self._set_render_mode(render_mode)
        self._episode: RunningEpisode | None = None
        self._renderer: Renderer | None = None

    @property
    def reference(self) -> Reference:
        """Reference of the running episode, a `Reference`: a function from T times (T,), s, to a `ReferencePoint`,
        positions, velocities and accelerations of the r joints, (T, r) each, in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if
        prismatic). Raises Gymnasium's `ResetNeeded` before the first reset."""
        return self._running("reference").preview.reference

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """First observation (5r + r L,) and `info` of a new episode, which this call begins. `info` has `time` (0 s),
        true `parameters` (P,), `applied_torque` (r,), 0 yet, `energy` (kinetic plus potential, J) and `clipped` (0);
        with effects also `p`, `v` and `flags`. For r joints the observation has positions, velocities and the
        reference's positions, velocities and accelerations, then its positions at L times ahead; rad, rad/s, rad/s^2
        (m, m/s, m/s^2 if prismatic). `seed` is that of the random numbers, None to go on with them; `options`, None for
        none, are `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and `inertia`
        (3, 3), kg m^2, about that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or "random"),
        `initial_error` (one number or (r,), rad, m if prismatic) and `parameters` (P,), the P true inertial and
        friction ones, SI, in the order of `Mechanism.parameter_names`. Raises `InputError` for a bad option (its
        subclasses `NotFoundError` for an unknown one, `NonFiniteError` for one that is not finite), `SingularityError`
        where loops cannot be followed to the start, Gymnasium's `Error` for a bad seed."""
        started = self._started(seed, options)
        self.plant.compile()
        return self._observation(started), self._info(started.parameters, started.state, 0, 0)

    def _started(self, seed: int | None, options: dict[str, Any] | None) -> RunningEpisode:
        """The episode that now begins."""
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
        """Observation (5r + r L,), reward, `terminated`, `truncated` and `info` after one control period, by which this
        call advances the episode under the torque `action` (r,), N m (N if prismatic), held and clipped to its limits.
        The observation has, for r joints, the measured positions and velocities, the reference's positions, velocities
        and accelerations, (r,) each, then its positions at each of L times ahead in turn; rad, rad/s, rad/s^2 (m, m/s,
        m/s^2 if prismatic). The reward, unitless, is minus the sums over the joints of squared position errors, squared
        velocity errors and (torque/limit)^2, each times its weight (`RewardWeights`), less the weight `termination`
        where terminated. `terminated` is True where a joint's error passes its bound or kinematic loops come near a
        singularity (their Jacobian's smallest singular value below 0.05 of its reference value) or leave bounds that
        the robot's file states, `truncated` where the duration is over. `info` has `time` (s), `parameters` (P,), the
        true inertial and friction ones (SI, in the order of `Mechanism.parameter_names`), `applied_torque` (r,), N m
        (N), `energy` (J) and `clipped`, the number of actions clipped so far; with effects also the true `p` and `v`
        (r,) and `flags`, a dict of events. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN, infinity and
        for a motion that diverges to non-finite values, Gymnasium's `ResetNeeded` before a reset."""
        episode = self._running("step")
        if episode.over:
            raise ResetNeeded("the episode is over: call env.reset() before the next env.step(action)")
        torque = self._torque(action)
        parameters = self._now(episode.parameters, episode.step)
        episode.state = state = self.plant.step(episode.state, torque, parameters, self._noise())
        episode.step += 1
        episode.clipped += state.clipped
        rewards, over = self._judged(state.q, state.v, self._reference(episode), state.applied)
        reward, terminated, truncated = float(rewards), bool(over), episode.step >= self.steps
        episode.over = terminated or truncated
        info = self._info(episode.parameters, state, episode.step, episode.clipped)
        return self._observation(episode), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """RGB image (480, 640, 3), uint8, of the arm now and a translucent ghost of it on the reference; None, with a
        warning in Gymnasium's log, without a render mode. Raises Gymnasium's `ResetNeeded` before the first reset."""
        episode = self._running("render")
        if self.render_mode is None:
            gymnasium.logger.warn("render: choose a mode when making the environment: render_mode='rgb_array'")
            return None
        if self._renderer is None:
            from adaptctl.envs.rendering import Renderer

            self._renderer = Renderer(self.mechanism)
        goal = episode.preview.row(episode.step)[: self.plant.dof]
        return self._renderer.image(episode.state.p, goal, episode.step * self.control_period)

    def episode(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Episode:
        """New episode as an `Episode`, which `simulate` runs in native code: what `reset` begins with the same `seed`
        and `options`, with the function that computes rewards and ends. The environment's generator draws its noise,
        and `step` takes no step before the next `reset`. Raises what `reset` raises, and `NotImplementedError` where a
        subclass has a `step` of its own, which then has to write this method as well."""
        if type(self).step is not TrackingEnv.step:
            raise NotImplementedError(f"{type(self).__name__} has a step of its own")
        if type(self).reset is TrackingEnv.reset:
            started = self._started(seed, options)  # what a step needs is not compiled
        else:
            self.reset(seed=seed, options=options)
            started = self._running("episode")
        started.over, reference = True, started.preview.reference
        told = self._judged, self._info
        return Episode(self.plant, started.state, started.parameters, reference, self.np_random, self.steps, *told)

    def _judged(self, q: Array, v: Array, reference: ReferencePoint, applied: Array) -> tuple[Array, NDArray[np.bool_]]:
        """The rewards (...) of states reached (...), one or (m,) of them, and whether the episode ends there."""
        judged = self.judgement.kernel if q.ndim == 1 else self.judgement.kernel.map
        reward, lost = judged(self.plant.positions(q), v, reference.p, reference.v, applied)
        terminated = ~self.plant.is_valid_configuration(q) | (np.asarray(lost) > 0.0)
        return reward - self.reward_weights.termination * terminated, terminated

    @cached_property
    def judgement(self) -> Judgement:
        """The `Judgement` of a control period: its reward, and whether a position error ends the episode."""
        return Judgement(self.reward_weights, self.error_bound, self._limits)

    def _reference(self, episode: RunningEpisode) -> ReferencePoint:
        row, r = episode.preview.row(episode.step), self.plant.dof
        return ReferencePoint(row[:r], row[r : 2 * r], row[2 * r : 3 * r])

    def _observation(self, episode: RunningEpisode) -> Array:
        return np.concatenate((episode.state.measured_p, episode.state.measured_v, episode.preview.row(episode.step)))

    def _info(
        self, own: Array, state: PlantState, steps: int, clipped: int, energy: float | None = None
    ) -> dict[str, Any]:
        """The info of a state reached after so many control periods, with the true parameters `own`, (P,), and its
        energy, J, if that is known."""
        parameters, time = self._now(own, steps), steps * self.control_period
        info: dict[str, Any] = {
            "time": time,
            "parameters": parameters.copy(),  # Gymnasium: what is returned is the caller's to change
            "applied_torque": state.applied if steps else np.zeros(self.plant.dof),
            "energy": self.plant.energy(state, parameters) if energy is None else energy,
            "clipped": clipped,
        }
        if self.plant.effects:
            flags = dict(zip(self.plant.flags, state.flags.tolist(), strict=True))
            if self.plant.loads:
                flags["payload"] = self.plant.payload(time)
            info |= {"p": state.p.copy(), "v": state.v.copy(), "flags": flags}
        return info

    def _now(self, parameters: Array, step: int) -> Array:
        """The true parameters at a step, what is held by then included."""
        if not self.plant.loads:
            return parameters
        return self.plant.parameters(parameters, step * self.control_period)

    def _noise(self) -> Array | None:
        """Standard normal numbers for the sensors; none are drawn where there are no sensors."""
        size = self.plant.noise_size
        return self.np_random.standard_normal(size) if size else None

    def _torque(self, action: ArrayLike) -> Array:
        torque = numbers(action, "action")
        if torque.shape != (self.plant.dof,):
            raise InputError(f"action: expected shape ({self.plant.dof},), got {torque.shape}")
        return torque

    def true_parameters(self, options: Mapping[str, Any]) -> Array:
        """The P true inertial and friction parameters (P,) of an episode, SI units, in the order of
        `Mechanism.parameter_names`, for the `options` of its reset: `parameters` (P,), else the mechanism's own, plus
        `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and `inertia` (3, 3), kg
        m^2, about that centre) on the last link with mass, in its frame. Raises `InputError` for another shape, a
        payload of no rigid body, or on a mechanism of fewer than ten parameters a link; `NonFiniteError` for parameters
        that are not finite."""
        own = finite_numbers(options.get("parameters", self.mechanism.inertial_parameters), "parameters")
        parameters = frozen_array(own, self.mechanism.inertial_parameters.shape, "parameters")
        if "payload" in options:
            validate_ten_a_link(self.mechanism)
            return Payload.of(options["payload"]).added_to(parameters, len(self.mechanism.description.bodies) - 1)
        return parameters

    def _running(self, what: str) -> RunningEpisode:
        if self._episode is None:
            raise ResetNeeded(f"{what}: there is no episode yet: call env.reset() first")
        return self._episode

    def _set_spaces(self) -> None:
        r, ahead = self.plant.dof, self.plant.dof * len(self.look_ahead)
        names = ("p", "v", "reference_p", "reference_v", "reference_a")
        slices = {name: slice(i * r, (i + 1) * r) for i, name in enumerate(names)}
        self.observation_slices = MappingProxyType(slices | {"look_ahead": slice(5 * r, 5 * r + ahead)})
        self._limits = np.asarray(self.plant.torque_limits)
        if not np.isfinite(self._limits).all():
            raise InputError(f"torque_limits: an action needs finite ones, got {self._limits.tolist()}")
        self.action_space = gymnasium.spaces.Box(-self._limits, self._limits, dtype=np.float64)
        shape = (5 * r + ahead,)
        self.observation_space = gymnasium.spaces.Box(-LARGEST_OBSERVATION, LARGEST_OBSERVATION, shape, np.float64)

    def _set_render_mode(self, render_mode: str | None) -> None:
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise NotFoundError(f"unknown render mode {render_mode!r}; modes: {', '.join(modes)}")
        self.render_mode = render_mode
        self.metadata = self.metadata | {"render_fps": 1.0 / self.control_period}
