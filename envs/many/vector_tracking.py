"""Vector tracking environments."""

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
from adaptctl.compilation.lanes import Precision
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.envs.built_in import Puma560TrackingEnv, SemiDirectDriveTrackingEnv
from adaptctl.envs.many.arms import Arms, Flags, Told, put
from adaptctl.envs.task import finite_actions, known_options
from adaptctl.envs.tracking import OPTIONS, TrackingEnv
from adaptctl.errors import InputError, NotFoundError

if TYPE_CHECKING:
    from adaptctl.envs.rendering import Renderer


@sent_as_made
class VectorTrackingEnv(VectorEnv[Array, Array, Any]):
    """
    Tracking task of N equal arms, simulated together in native code.

    Parameters
    ----------
    num_envs : int, default 1
        Number N of arms, at least 1. One by default, as in `gymnasium.make_vec`.
    autoreset_mode : AutoresetMode or str, default "NextStep"
        When an arm is reset after the end of its episode, see Notes.
    reset_options : Mapping, optional
        Default options of every reset, automatic resets included. Default: none.
    precision : {"double", "single"}, default "double"
        Floating-point precision of the simulation. Single is faster, but positions deviate by some 1e-6 rad in 100
        steps.
    **settings : object
        Arguments of `TrackingEnv`, the same for all arms; `reference` may also be a list of N.

    Raises
    ------
    InputError
        If a number, mode or precision is not as above, the mechanism has more than 100 links, or its loops cannot be
        closed in single precision.
    NotFoundError
        If an option is unknown. Other errors are those of `TrackingEnv`; those in `reset_options` and lists of
        references are raised at the reset.

    Notes
    -----
    Arm i equals a `TrackingEnv` with its seed, options and actions, to round-off. Mechanisms have at most 100 links.

    ## Action space

    `Box(-limit, limit, (N, r), float64)`: torques in N m (N), clipped.

    ## Observation space

    `Box(-1e6, 1e6, (N, 5r + r L), float64)` for L look-ahead times; `observation_slices` has the slices of columns.

    ## Rewards and episode end

    `rewards`, `terminations` and `truncations` are (N,). If a motion diverges, reset all arms.

    ## Beginning again

    - `"NextStep"`: an arm begins again at the next step, which ignores its action, with reward 0
    - `"SameStep"`: at once; `info` has `final_obs` and `final_info`
    - `"Disabled"`: at `reset(options={"reset_mask": mask})`, `mask` (N,) of bools

    ## Information

    Arrays with a leading axis of arms; a mask `_key` (N,) says which arms have `key`.

    ## Options at reset

    One for all arms or one each: `initial_error` (N, r), `parameters` (N, P), lists of `payload` and `trajectory`.
    Trajectories other than `Sinusoids` are sampled, which is slower.

    Examples
    --------
    >>> import gymnasium
    >>> settings = {"robot": arm, "reference": reference, "duration": 0.1}
    >>> many = gymnasium.make_vec("adaptctl.envs:adaptctl/Tracking-v0", num_envs=3, **settings)
    >>> many.reset(seed=0, options={"initial_error": 0.1})[0].shape
    (3, 14)
    """

    kind: ClassVar[type[TrackingEnv]] = TrackingEnv
    """Class of the single environment."""
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
        if settings.get("render_mode") == "human":
            raise NotFoundError("unknown render mode 'human' of many arms; modes: rgb_array")
        self.single, self.num_envs = self.kind(**settings), int(num_envs)
        self._validate_short()
        self.reset_options = known_options(reset_options, OPTIONS)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = self.single.metadata | {"autoreset_mode": self.autoreset_mode, "render_modes": ["rgb_array"]}
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
        self._renderer: Renderer | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """
        Begin new episodes.

        Parameters
        ----------
        seed : int or sequence, optional
            With a number, arm i gets the seed plus i. A sequence has one seed for each arm, or None to continue its
            random numbers. Default: all continue.
        options : Mapping, optional
            Options at reset, see the class; with `autoreset_mode` "Disabled" also `reset_mask` (N,). Default:
            `reset_options`.

        Returns
        -------
        tuple
            First observations (N, n) and `info`, see the class.

        Raises
        ------
        InputError
            If a seed or an option is bad.
        NotFoundError
            If an option is unknown.
        NonFiniteError
            If an option is not finite.
        SingularityError
            If loops cannot be followed to the start.
        gymnasium.error.ResetNeeded
            If some arms are reset before the first reset of all.
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
        """
        Advance all arms by a control period.

        Parameters
        ----------
        actions : array_like
            Torques (N, r) in N m (N if prismatic), clipped to the limits and held.

        Returns
        -------
        tuple
            Observations (N, n), rewards (N,), `terminated` and `truncated` (N,), and `info`, see the class.

        Raises
        ------
        InputError
            If the shape is wrong; no arm moves.
        NonFiniteError
            If an action (no arm moves) or a motion is NaN or infinite.
        gymnasium.error.ResetNeeded
            If an arm is not running.
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
        """
        Draw every arm and a translucent copy of it at its reference position.

        Returns
        -------
        tuple of ndarray or None
            RGB images (480, 640, 3), uint8; None, with a warning of Gymnasium, without a render mode.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If there was no reset.
        """
        self._validate_running(self._none)
        if self.render_mode is None:
            gymnasium.logger.warn("render: set a mode when creating the environment: render_mode='rgb_array'")
            return None
        if self._renderer is None:
            from adaptctl.envs.rendering import Renderer

            self._renderer = Renderer(self.single.mechanism)
        goals = self._arms.rows(self._arms.all)[:, : self.single.plant.dof]
        times = self.control_period * self._arms.steps
        arms = zip(self._arms.positions, goals, times.tolist(), strict=True)
        return tuple(self._renderer.image(p, goal, time) for p, goal, time in arms)

    def _begin(self, result: Told, chosen: Flags) -> None:
        if chosen.any():
            arms = np.flatnonzero(chosen)
            put(result, arms, self._arms.begin(arms, self.reset_options))

    def _final(self, result: Told) -> dict[str, Any]:
        observations = np.full(self.num_envs, None, dtype=object)
        for arm in np.flatnonzero(self._over).tolist():
            observations[arm] = result["observation"][arm].copy()
        return masked({"final_obs": observations}, self._over) | {
            "final_info": self._info(result, self._over),
            "_final_info": self._over.copy(),
        }

    def _info(self, result: Told, mask: Flags) -> dict[str, Any]:
        """`info` of the arms in the mask."""
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
        if given is None:
            return self._all
        mask = np.array(given)
        if self.autoreset_mode is not AutoresetMode.DISABLED:
            raise InputError(
                "reset_mask is only for autoreset_mode=AutoresetMode.DISABLED; otherwise arms are reset automatically"
            )
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise InputError(f"reset_mask: expected {self.num_envs} bools, not all False, got {mask.tolist()}")
        if self._latest is None and not mask.all():
            raise ResetNeeded("reset_mask: no episode has started: reset all arms first")
        return mask

    def _validate_running(self, over: Flags) -> None:
        if self._latest is None:
            raise ResetNeeded("no episode has started: call env.reset() first")
        if over.any():
            raise ResetNeeded(
                f"the episode of arm {int(over.argmax())} is over: call env.reset(options={{'reset_mask': ...}}) first"
            )

    def _validate_short(self) -> None:
        mechanism = self.single.mechanism
        if len(mechanism.links) > MAX_COMPILED_LINKS:
            raise InputError(
                f"{mechanism.name}: has {len(mechanism.links)} links, but native code is limited to "
                f"{MAX_COMPILED_LINKS}: use vectorization_mode='sync'"
            )


class Puma560VectorTrackingEnv(VectorTrackingEnv):
    """
    Tracking task of N PUMA 560 arms: a `VectorTrackingEnv` with the defaults of `Puma560TrackingEnv`.

    Parameters
    ----------
    num_envs : int, default 1
        Number N of arms, at least 1. One by default, as in `gymnasium.make_vec`.
    autoreset_mode : AutoresetMode or str, default "NextStep"
        Time at which an arm whose episode ended is reset, as in `VectorTrackingEnv`.
    reset_options : Mapping, optional
        Options of every reset that is not given others.
    precision : {"double", "single"}, default "double"
        Precision of the numbers, as in `VectorTrackingEnv`; double equals a single environment to round-off.
    **settings : object
        Arguments of `Puma560TrackingEnv`, the same for all arms.

    Examples
    --------
    >>> from adaptctl.envs import Puma560VectorTrackingEnv
    >>> Puma560VectorTrackingEnv(2).action_space.shape
    (2, 6)
    """

    kind = Puma560TrackingEnv


class SemiDirectDriveVectorTrackingEnv(VectorTrackingEnv):
    """
    Tracking task of N arms with a five-bar linkage, with the defaults of `SemiDirectDriveTrackingEnv`.

    Parameters
    ----------
    num_envs : int, default 1
        Number N of arms, at least 1. One by default, as in `gymnasium.make_vec`.
    autoreset_mode : AutoresetMode or str, default "NextStep"
        Time at which an arm whose episode ended is reset, as in `VectorTrackingEnv`.
    reset_options : Mapping, optional
        Options of every reset that is not given others.
    precision : {"double", "single"}, default "double"
        Precision of the numbers, as in `VectorTrackingEnv`; double equals a single environment to round-off.
    **settings : object
        Arguments of `SemiDirectDriveTrackingEnv`, the same for all arms.

    Examples
    --------
    >>> from adaptctl.envs import SemiDirectDriveVectorTrackingEnv
    >>> SemiDirectDriveVectorTrackingEnv.kind.__name__
    'SemiDirectDriveTrackingEnv'
    """

    kind = SemiDirectDriveTrackingEnv


def _copied(result: Told) -> Told:
    return {name: values.copy() for name, values in result.items()}


def masked(values: Mapping[str, Any], mask: Flags) -> dict[str, Any]:
    """Entries of `info` with Gymnasium's masks."""
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
