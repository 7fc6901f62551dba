"""The tracking environments for many arms at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array
from adaptctl.caching import sent_as_made
from adaptctl.compilation.kernel import MAX_COMPILED_LINKS
from adaptctl.compilation.lanes import Precision
from adaptctl.envs.built_in import Puma560TrackingEnv, SemiDirectDriveTrackingEnv
from adaptctl.envs.many.arms import Arms, Flags, Told, put
from adaptctl.envs.task import finite_actions, known_options
from adaptctl.envs.tracking import OPTIONS, TrackingEnv
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.envs.rendering import Renderer


@sent_as_made
class VectorTrackingEnv(VectorEnv[Array, Array, Any]):
    """
    ## Description

    A vector environment of N arms of r joints, each in a `TrackingEnv` of its own, in which it is to follow a reference
    trajectory under joint torques. The arms take their steps together in native code: as many at a time as a register
    of the processor holds. Whatever the card of `TrackingEnv` says holds for every arm; this one says what many of them
    add. Arm i is the single environment with its seed, options and actions, to round-off.

    ```python
    import gymnasium
    env = gymnasium.make_vec("adaptctl.envs:adaptctl/Puma560Tracking-v0", num_envs=1024)
    ```

    `adaptctl/SemiDirectDriveTracking-v0` and `adaptctl/Tracking-v0` likewise, or `VectorTrackingEnv(1024, robot=...)`.
    With `vectorization_mode="sync"` Gymnasium loops over single environments instead.

    ## Action space

    `Box(-limit, limit, (N, r), float64)`: torques in N m (N of prismatic joints), `limit` being the torque limits. What
    is out of bounds is clipped and counted; NaN and infinity raise `NonFiniteError`, which names the joint and the arm,
    a wrong shape `InputError`, before anything moves.

    ## Observation space

    `Box(-1e6, 1e6, (N, 5r + r L), float64)` for L look-ahead times, in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if
    prismatic), for every arm as in `TrackingEnv`: positions `p`, velocities `v`, `reference_p`, `reference_v` and
    `reference_a`, r each, and the reference's positions at the L times ahead. `observation_slices` has slices of the
    columns by name, for `observation[:, env.unwrapped.observation_slices["p"]]`. `Controller.step` takes these columns
    as they are.

    ## Rewards and episode end

    `rewards`, no unit, `terminations` and `truncations`, bools, are (N,): an arm's episode is terminated when an error
    passes `error_bound`, or a mechanism with loops nears a singularity or breaks a condition of its file, and truncated
    at `duration`. An arm that ends disturbs no other. A motion that diverges to non-finite values raises
    `NonFiniteError`, which names the arm; then reset all.

    ## Beginning again

    `metadata["autoreset_mode"]` says what happens to arms whose episode ends (`gymnasium.vector.AutoresetMode`):

    | `autoreset_mode` | An arm whose episode has ended                                                        |
    |------------------|---------------------------------------------------------------------------------------|
    | `"NextStep"`     | begins again at the next step, which ignores its action, with reward 0: the default   |
    | `"SameStep"`     | begins again at once; `info` has `final_obs` and `final_info`                         |
    | `"Disabled"`     | waits for `reset(options={"reset_mask": mask})`, `mask` (N,) of bools                 |

    ## Seeds

    `reset(seed=s)` gives arm i the seed s + i, whole numbers of at least 0; a list has one for each, None for an arm
    that goes on as it would.

    ## Information

    As in `TrackingEnv`, with a leading axis of arms: `time`, `parameters`, `applied_torque`, `energy`, `clipped`, and
    with effects `p`, `v` and `flags`. For every key a mask `_key` (N,) says which arms have it. `parameters` and the
    masks are read-only.

    ## Arguments

    Those of `TrackingEnv`, the same for all arms, but `reference`, which may also be a list of N, and

    | Argument         | Default      | Meaning                                                                        |
    |------------------|--------------|--------------------------------------------------------------------------------|
    | `num_envs`       | 1            | the number N of arms                                                           |
    | `autoreset_mode` | `"NextStep"` | see above                                                                      |
    | `reset_options`  | `None`       | options of every reset, where it is not given others, those that arms begin again with included |
    | `precision`      | `"double"`   | `"single"` for twice as many arms in a register, 7 digits instead of 16: arm i is then the single environment to some 1e-6 rad in 100 steps |

    Mechanisms may have at most 100 links. Raises `InputError` for more, for `num_envs` that is no whole number of at
    least 1, another mode or precision, and a mechanism whose loops single precision leaves open; `NotFoundError` for
    unknown options, and what `TrackingEnv` raises. What is wrong in `reset_options` or a list of references is raised
    at the reset.

    ## Options at reset

    Those of `TrackingEnv`, for all arms or one each: `initial_error` also (N, r), `parameters`, P an arm, also (N, P),
    `payload` and `trajectory` also a list of N. Sums of sinusoids (`Sinusoids`, random ones) are evaluated natively by
    each arm's own numbers; other references are sampled, which is slower.

    ## Version history

    * v0: first version
    """  # noqa: E501  # tables

    kind: ClassVar[type[TrackingEnv]] = TrackingEnv
    """Class of the single environment that each arm is in."""
    metadata: dict[str, Any] = TrackingEnv.metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        reset_options: Mapping[str, Any] | None = None,
        precision: Precision = "double",
        **settings: Any,
    ) -> None:
        if not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise InputError(f"num_envs: expected a whole number of at least 1, got {num_envs}")
        self.single, self.num_envs = self.kind(**settings), int(num_envs)
        self._validate_short()
        self.reset_options = known_options(reset_options, OPTIONS)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = self.single.metadata | {"autoreset_mode": self.autoreset_mode}
        self.render_mode, self.control_period = self.single.render_mode, self.single.control_period
        self.single_observation_space, self.single_action_space = (
            self.single.observation_space,
            self.single.action_space,
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_slices = self.single.observation_slices
        self._arms = Arms(self.single, self.num_envs, precision)
        self._all: Flags = np.ones(self.num_envs, dtype=np.bool_)
        self._none: Flags = np.zeros(self.num_envs, dtype=np.bool_)
        for flags in (self._all, self._none):
            flags.flags.writeable = False
        self._over = self._none
        self._latest: Told | None = None
        """the last results, in arrays of their own"""
        self._renderer: Renderer | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """First observations (N, n), n = 5r + r L, and `info` of new episodes of all N arms, which this call begins;
        with `autoreset_mode` "Disabled" alone, only of those in the option `reset_mask`, bools (N,), not all False. A
        row of observations has, for r joints and L look-ahead times, the measured positions and velocities, the
        reference's positions, velocities and accelerations, (r,) each, then its positions at each time ahead in turn;
        rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic). `info` has `time`, `parameters`, `applied_torque`, `energy`
        and `clipped` and, with effects, `p`, `v` and `flags`, as in `step`, and for each key a mask `_key` (N,) of the
        arms that have started.

        `seed` s gives arm i, from 0, the seed s + i, a list has one for each arm, and None lets the random numbers go
        on. `options`, None for those in `reset_options` alone, replace these, for all arms or one each: `payload` (a
        mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and `inertia` (3, 3), kg m^2, about
        that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or "random"), `initial_error` (one
        number, (r,) or (N, r), rad, m if prismatic) and `parameters`, (P,) or (N, P), the P true inertial and friction
        ones, SI units, in the order of `Mechanism.parameter_names`. Raises `InputError` for bad seeds and options (its
        subclasses `NotFoundError` for unknown options, `NonFiniteError`, naming the arm, for numbers that are not
        finite); `SingularityError` where loops cannot be followed to the start; Gymnasium's `ResetNeeded` for a part of
        the arms before the first reset of all.
        """
        given = dict(known_options(options, (*OPTIONS, "reset_mask")))
        mask = self._mask(given.pop("reset_mask", None))
        chosen = np.flatnonzero(mask)
        for arm, own in self._seeds(seed):
            if mask[arm]:
                self._arms.streams.seed(arm, own)
        started = self._arms.begin(chosen, {**self.reset_options, **given})
        if self._latest is None or chosen.size == self.num_envs:
            self._latest = started
        else:
            put(self._latest, chosen, started)
        self._over = self._over & ~mask
        result = _copied(self._latest)
        return result["observation"], self._info(result, mask)

    def step(self, actions: ArrayLike) -> tuple[Array, Array, Flags, Flags, dict[str, Any]]:
        """Observations (N, n), n = 5r + r L, rewards (N,), unitless, `terminated` and `truncated`, bools (N,), and
        `info` after one control period, by which this call advances all N arms. `actions` are torques (N, r), N m (N if
        prismatic), held and clipped to the torque limits. A row of observations has, for r joints and L look-ahead
        times, the measured positions and velocities, the reference's positions, velocities and accelerations, (r,)
        each, then its positions at each time ahead in turn; rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic). A reward
        is minus the sums over the joints of squared position errors, squared velocity errors and (torque/limit)^2, each
        times its weight (`RewardWeights`), less the weight `termination` where terminated.

        `terminated` is True where a joint's error passes its bound or kinematic loops come near a singularity (the
        smallest singular value of their closure Jacobian below 0.05 of that at the reference configuration) or leave
        bounds that the robot's file states, `truncated` where the duration is over. `info` has `time` (N,), s,
        `parameters` (N, P), the P true inertial and friction ones (SI units, in the order of
        `Mechanism.parameter_names`), `applied_torque` (N, r), N m (N), `energy` (N,), kinetic plus potential, J, and
        `clipped` (N,), the number of actions clipped so far; with effects also the true `p` and `v` (N, r) and `flags`,
        a dict of events; for each key a mask `_key` (N,) of arms; with `autoreset_mode` "SameStep" `final_obs` and
        `final_info` of episodes that ended. Raises `InputError` on a wrong shape and `NonFiniteError`, naming joint and
        arm, on NaN and infinity, before anything has moved; `NonFiniteError`, naming the arm, for a motion that
        diverges to non-finite values; Gymnasium's `ResetNeeded` before the first reset, and with `autoreset_mode`
        "Disabled" where an arm's episode is over.
        """
        again = self._over if self.autoreset_mode is AutoresetMode.NEXT_STEP else self._none
        self._validate_running(self._over & ~again)
        moving = np.flatnonzero(~again) if again.any() else self._arms.all
        result = self._arms.advance(finite_actions(actions, self.action_space, "joint", again), moving)
        self._begin(result, again)
        reward, terminated, truncated = (result[name] for name in ("reward", "terminated", "truncated"))
        self._over = terminated | truncated
        ended: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            ended, over, result = self._final(result), self._over, _copied(result)
            self._begin(result, over)
            self._over = self._none
        if self.autoreset_mode is AutoresetMode.DISABLED:
            self._latest = _copied(result)
        return result["observation"], reward, terminated, truncated, ended | self._info(result, self._all)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Tuple of RGB images (480, 640, 3), uint8, one an arm, each of the arm now and a translucent ghost of it on
        its reference; None, with a warning in Gymnasium's log, without a render mode. Raises Gymnasium's `ResetNeeded`
        before the first reset."""
        self._validate_running(self._none)
        if self.render_mode is None:
            gymnasium.logger.warn("render: choose a mode when making the environment: render_mode='rgb_array'")
            return None
        if self._renderer is None:
            from adaptctl.envs.rendering import Renderer

            self._renderer = Renderer(self.single.mechanism)
        goals = self._arms.rows(self._arms.all)[:, : self.single.plant.dof]
        times = self.control_period * self._arms.steps
        arms = zip(self._arms.positions, goals, times.tolist(), strict=True)
        return tuple(self._renderer.image(p, goal, time) for p, goal, time in arms)

    def _begin(self, result: Told, chosen: Flags) -> None:
        """Begin an episode of some arms, and put its beginning into the result."""
        if chosen.any():
            arms = np.flatnonzero(chosen)
            put(result, arms, self._arms.begin(arms, self.reset_options))

    def _final(self, result: Told) -> dict[str, Any]:
        """Gymnasium's entries on episodes that end in this step."""
        observations = np.full(self.num_envs, None, dtype=object)
        for arm in np.flatnonzero(self._over).tolist():
            observations[arm] = result["observation"][arm].copy()
        return masked({"final_obs": observations}, self._over) | {
            "final_info": self._info(result, self._over),
            "_final_info": self._over.copy(),
        }

    def _info(self, result: Told, mask: Flags) -> dict[str, Any]:
        """The `info` of the arms in the mask; others have zeros."""
        info = {name: result[name] for name in ("time", "energy", "clipped")}
        info |= {"parameters": self._arms.parameters, "applied_torque": result["torque"]}
        plant = self.single.plant
        if plant.effects:
            flags = dict(zip(plant.flags, result["flags"].T, strict=True))
            if plant.loads:
                flags["payload"] = self._arms.payload.copy()
            info |= {"p": result["p"], "v": result["v"], "flags": masked(flags, mask)}
        return masked(info, mask)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[tuple[int, int]]:
        """Arms and the seeds they are given."""
        if seed is None:
            return []
        try:
            given = range(seed, seed + self.num_envs) if isinstance(seed, int | np.integer) else list(seed)
        except TypeError as error:
            raise InputError(f"seed: expected a number, or one for each of the arms, got {seed!r}") from error
        if len(given) != self.num_envs:
            raise InputError(f"seed: expected a number, or one for each of {self.num_envs} arms, got {len(given)}")
        chosen = [(arm, own) for arm, own in enumerate(given) if own is not None]
        for arm, own in chosen:
            if not isinstance(own, int | np.integer) or own < 0:
                raise InputError(f"seed: expected whole numbers of at least 0, got {own!r} for arm {arm}")
        return [(arm, int(own)) for arm, own in chosen]

    def _mask(self, given: Any) -> Flags:
        """Mask of the arms that are to be reset. Raises `InputError` for another shape or mode, `ResetNeeded` before
        the first reset."""
        if given is None:
            return self._all
        mask = np.array(given)
        if self.autoreset_mode is not AutoresetMode.DISABLED:
            raise InputError(
                "reset_mask: arms begin again by themselves; it is for autoreset_mode=AutoresetMode.DISABLED"
            )
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise InputError(f"reset_mask: expected {self.num_envs} bools, not all False, got {mask.tolist()}")
        if self._latest is None and not mask.all():
            raise ResetNeeded("reset_mask: there is no episode yet: reset all arms first")
        return mask

    def _validate_running(self, over: Flags) -> None:
        if self._latest is None:
            raise ResetNeeded("there is no episode yet: call env.reset() first")
        if over.any():
            raise ResetNeeded(
                f"the episode of arm {int(over.argmax())} is over: call env.reset(options={{'reset_mask': ...}}) first"
            )

    def _validate_short(self) -> None:
        mechanism = self.single.mechanism
        if len(mechanism.links) > MAX_COMPILED_LINKS:
            raise InputError(
                f"{mechanism.name}: has {len(mechanism.links)} links, and native code is made for at most "
                f"{MAX_COMPILED_LINKS}: use vectorization_mode='sync'"
            )


class Puma560VectorTrackingEnv(VectorTrackingEnv):
    """Vector environment of N PUMA 560 arms, six joints each: a `VectorTrackingEnv` with the arguments and defaults of
    `Puma560TrackingEnv`. Actions are (N, 6), torques in N m; observations (N, 42): positions, velocities, the
    reference's positions, velocities and accelerations, and its positions 0.05 and 0.2 s ahead, six each, rad, rad/s,
    rad/s^2. Raises what `VectorTrackingEnv` raises: `InputError` for bad values, of these `NotFoundError` for an
    unknown built-in robot, render mode or reset option and `FileError` for a bad file."""

    kind = Puma560TrackingEnv


class SemiDirectDriveVectorTrackingEnv(VectorTrackingEnv):
    """Vector environment of N semi-direct-drive arms, three primary (independent) joints each: a `VectorTrackingEnv`
    with the arguments and defaults of `SemiDirectDriveTrackingEnv`. Actions are (N, 3), torques in N m; observations
    (N, 21): positions, velocities, the reference's positions, velocities and accelerations, and its positions 0.05 and
    0.2 s ahead, three each, rad, rad/s, rad/s^2. Raises what `VectorTrackingEnv` raises: `InputError` for bad values,
    of these `NotFoundError` for an unknown built-in robot, render mode or reset option and `FileError` for a bad
    file."""

    kind = SemiDirectDriveTrackingEnv


def _copied(result: Told) -> Told:
    return {name: values.copy() for name, values in result.items()}


def masked(values: Mapping[str, Any], mask: Flags) -> dict[str, Any]:
    """Entries of a vector environment's `info` in Gymnasium's form, a dict: the `values` by name, arrays with a row for
    each of N arms, or mappings, and for each name the `mask` (N,), bools, by the name with an underscore before it. In
    arrays of numbers the rows of arms outside the mask become zero; mappings and arrays of objects are not changed.
    Nothing is checked."""
    info: dict[str, Any] = {}
    partial = not mask.all()
    for name, value in values.items():
        if partial and not isinstance(value, dict) and value.dtype != object:
            value = np.where(mask.reshape(-1, *[1] * (value.ndim - 1)), value, np.zeros((), value.dtype))
        info |= {name: value, f"_{name}": mask}
    return info


def _mode(given: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(given)
    except ValueError as error:
        modes = ", ".join(mode.value for mode in AutoresetMode)
        raise InputError(f"autoreset_mode: expected one of {modes}, got {given!r}") from error
