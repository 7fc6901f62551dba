"""Safety filter of a controller."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_per_joint
from adaptctl.compilation.sine import sine_for
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.gains.sampling_ratio import validate_period
from adaptctl.control.pytree import either, leaves, row_each
from adaptctl.control.ringing import Ringing
from adaptctl.dynamics.equations import ClosedPositions
from adaptctl.errors import InputError, validate_kind
from adaptctl.scalars import Column, Scalar, absolute, clip, column, maximum, minimum, where
from adaptctl.scalars.scalar import Condition

MAX_SLIDING_VARIABLE = 1e6  # rad/s (m/s), so that its square stays finite
MAX_POSITION = sine_for("double").farthest  # rad (m), beyond which exported code has no sine
MAX_FLOAT = float(np.finfo(np.float64).max)

Parts = TypeVar("Parts", bound=tuple[Any, ...])


class SafetyFlags(NamedTuple):
    """
    Flags (1,), 1 or 0, of the limits that a safety filter enforced in a control period.

    Parameters
    ----------
    torque_limited : ndarray
        1 if a torque exceeded its limit, shape (1,).
    rate_limited : ndarray
        1 if a torque would have changed faster than its limit, shape (1,).
    frozen : ndarray
        1 if nothing is learned from the period that begins, shape (1,).
    bounded : ndarray
        1 if an estimate was brought back to its bounds, shape (1,).
    ringing : ndarray
        1 if a joint's sliding variable changes its sign every period, shape (1,): its correlation with itself one
        period ago was below -0.5 for 25 periods.
    stopped : ndarray
        1 while the arm is braked until `init` makes a new state, shape (1,): a number was not finite, a joint left its
        limits, or its correlation was below -0.9 for 25 periods.

    Examples
    --------
    >>> safe = adaptctl.control.SafetyFilter(law, torque_limits=1e-6)
    >>> _, state = safe.step(safe.init(p, v), p, v, reference(0.0))
    >>> float(state.flags.torque_limited[0])
    1.0
    """

    torque_limited: Any
    rate_limited: Any
    frozen: Any
    bounded: Any
    ringing: Any
    stopped: Any


class SafetyFilterState(NamedTuple):
    """
    Internal state of a controller within a safety filter.

    Parameters
    ----------
    inner : tuple
        Internal state of the wrapped controller.
    torque : ndarray
        Last torque (r,) given out in N m (N).
    ringing : Ringing
        Detector of ringing.
    flags : SafetyFlags
        Limits that the filter enforced in the last control period, 1 or 0 each.

    Examples
    --------
    >>> state = adaptctl.control.SafetyFilter(law).init(p, v)
    >>> float(state.flags.stopped[0])
    0.0
    """

    inner: Any
    torque: Any
    ringing: Ringing
    flags: SafetyFlags

    @property
    def estimate(self) -> Any:
        """Estimate (k,) of the controller."""
        return self.inner.estimate

    @property
    def logged_state(self) -> Any:
        """Numbers of the adaptation law's state that a run records."""
        return self.inner.logged_state


@dataclass(frozen=True, eq=False)
class SafetyFilter(Controller[SafetyFilterState]):
    """
    Controller with limited torques and estimates, and an emergency brake.

    Parameters
    ----------
    inner : Controller
        Controller for r joints.
    torque_limits : array_like, default inf
        Torque limits in N m (N), one number or (r,). Infinity, the default, is off: limits are the drives' own. Limits
        that are lowered while a state is carried on take effect at the rate limits: until then, torques exceed them.
    rate_limits : array_like, default inf
        Limits of the torque's rate in N m/s (N/s), one number or (r,). Infinity, the default, is off and needs no
        control period.
    estimate_bounds : tuple of array_like, optional
        Lower and upper bounds of the estimate in SI units, one number or (k,) each. Default: none.
    stop_damping : array_like, optional
        Damping in N m s/rad (N s/m) with which the arm is braked, that of the controller unless given.
    freeze : bool, default True
        True if nothing is learned from a period whose torque is limited, as the error is then not the estimate's [1]_.
    control_period : float, optional
        Control period in s, that of the controller unless given.
    position_limits : tuple of array_like, optional
        Lower and upper positions in rad (m), one number or (r,) each, beyond which the arm is braked. Default: none.
    velocity_limits : array_like, default inf
        Speeds in rad/s (m/s), one number or (r,), beyond which the arm is braked. Infinity, the default, is off.

    Raises
    ------
    InputError
        If a limit is not positive, a shape is wrong, bounds do not rise or exclude the initial estimate, the controller
        estimates nothing to bound, a damping is negative, or a damping or a needed period is missing.
    NonFiniteError
        If a number is NaN.

    Notes
    -----
    The arm is braked once a number is not finite, a joint leaves its limits or 1048576 rad (m), the range of the
    exported sine, or it rings. Gravity is not compensated then: a mechanical brake must hold the arm.

    References
    ----------
    .. [1] Astrom and Hagglund, Advanced PID Control, 2006, section 3.5.

    Examples
    --------
    >>> safe = adaptctl.control.SafetyFilter(law, torque_limits=[20.0, 5.0])
    >>> state = safe.init(p, v)
    >>> torque, state = safe.step(state, p, np.array([np.nan, 0.0]), reference(0.0))
    >>> float(state.flags.stopped[0])
    1.0
    """

    inner: Controller[Any]
    torque_limits: ArrayLike = np.inf
    rate_limits: ArrayLike = np.inf
    estimate_bounds: tuple[ArrayLike, ArrayLike] | None = None
    stop_damping: ArrayLike | None = None
    freeze: bool = True
    control_period: float | None = None
    position_limits: tuple[ArrayLike, ArrayLike] | None = None
    velocity_limits: ArrayLike = np.inf

    def __post_init__(self) -> None:
        validate_kind(self.inner, Controller, "safety filter", "as SlotineLi(...) is one")
        if not isinstance(self.freeze, bool):
            raise InputError(f"freeze: expected True or False, got {self.freeze!r}")
        for name in ("torque_limits", "rate_limits", "velocity_limits"):
            object.__setattr__(self, name, positive_per_joint(getattr(self, name), self.dof, name, infinite=True))
        own = getattr(self.inner, "damping", None) if self.stop_damping is None else self.stop_damping
        if own is None:
            raise InputError(f"stop_damping: {type(self.inner).__name__} has no damping for braking: give one")
        object.__setattr__(self, "stop_damping", _brake_damping(own, self.dof))
        if self.control_period is None:
            object.__setattr__(self, "control_period", getattr(self.inner, "control_period", None))
        if self.control_period is not None:
            validate_period(self.control_period)
        if self.position_limits is not None:
            object.__setattr__(
                self, "position_limits", _pair(self.position_limits, self.dof, "position_limits", "joint")
            )
        if np.isfinite(np.asarray(self.rate_limits)).any() and self.control_period is None:
            raise InputError(
                f"control_period: {type(self.inner).__name__} has no control period, which rate limits need: give one"
            )
        if self.estimate_bounds is not None:
            object.__setattr__(self, "estimate_bounds", _bounds(self.inner, self.estimate_bounds))

    @property
    def tunable(self) -> tuple[str, ...]:
        """Attributes that change without compiling again."""
        rates = ("rate_limits",) if self._limits_rates else ()
        return ("torque_limits", "stop_damping", "estimate_bounds", *rates)

    @property
    def _limits_rates(self) -> bool:
        limited = isinstance(self.rate_limits, Column) or bool(np.isfinite(np.asarray(self.rate_limits)).any())
        return limited and self.control_period is not None

    @property
    def dof(self) -> int:
        """Number r of joints."""
        return self.inner.dof

    @property
    def neutral_configuration(self) -> Array:
        """Neutral positions (r,) in rad (m)."""
        return self.inner.neutral_configuration

    @property
    def reference_size(self) -> int:
        """Length of a reference point's parts."""
        return self.inner.reference_size

    def initial_state(self, p: Array, v: Array) -> SafetyFilterState:
        """
        Return the wrapped initial state with zero torque and flags.

        Parameters
        ----------
        p, v : ndarray
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s).

        Returns
        -------
        SafetyFilterState
            Internal state before the first control period.
        """
        flags = SafetyFlags(*(np.zeros(1) for _ in SafetyFlags._fields))
        return SafetyFilterState(self.inner.initial_state(p, v), np.zeros(self.dof), Ringing.zero(self.dof), flags)

    def init(
        self, p: ArrayLike, v: ArrayLike, gains: Mapping[str, Array] | None = None, torque: ArrayLike | None = None
    ) -> SafetyFilterState:
        """
        Return the internal state before the first control period.

        Parameters
        ----------
        p, v : array_like
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s).
        gains : dict, optional
            Tunable gains of each arm by their names in `numbers`.
        torque : array_like, optional
            Torque (..., r) in N m (N) that is applied now, from which limited rates count. Zero unless given, which is
            for an arm that nothing drives.

        Returns
        -------
        SafetyFilterState
            Internal state for `step`.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> from adaptctl.control import SafetyFilter
        >>> safe = SafetyFilter(law, torque_limits=[50.0, 20.0], velocity_limits=[3.0, 3.0])
        >>> safe.init(p, v, torque=[1.0, 0.5]).estimate.shape == (len(model.names),)
        True
        """
        state = super().init(p, v, gains)
        if torque is None:
            return state
        arms = np.shape(p)[:-1]
        applied = row_each(self._measured(torque, "torque"), arms, "torque")
        return self._remembering(self._array_of(_holding(state, applied), arms))

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: SafetyFilterState
    ) -> tuple[Column, SafetyFilterState]:
        """
        Compute the torque within the limits, or that of the brake; 0 where a number is not finite.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : SafetyFilterState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and SafetyFilterState
            Torque (r,) in N m (N) and internal state after the period.
        """
        given = (p, v, *reference)
        clean = list(map(_finite_or_zero, given))
        torque, after = self.inner.law(clean[0], clean[1], ReferencePoint(*clean[2:]), memory.inner)
        after, bounded = self._bounded(after)
        sound = _all_finite((*given, torque, *leaves(after)))
        detector = memory.ringing.updated(self._sliding(sound, after, clean))
        lost = maximum(self._outside(clean[0], clean[1]), detector.brake)
        stopped = where(sound, maximum(memory.flags.stopped[0], lost), 1.0)
        torque = either(stopped > 0.5, -(column(self.stop_damping) * clean[1]), torque)
        after = _chosen(stopped > 0.5, memory.inner, after)
        limits = Column(minimum(limit, MAX_FLOAT) for limit in column(self.torque_limits))
        limited = Column(map(clip, torque, -limits, limits))
        applied = self._within_reach(limited, memory)
        beyond, too_fast = _differ(torque, limited), _differ(limited, applied)
        frozen = maximum(beyond, too_fast) if self.freeze else 0.0
        after = _with_applied_torque(after, applied)
        after = _without_learning(frozen > 0.5, after) if self.freeze else after
        flags = SafetyFlags(*(Column((flag,)) for flag in (beyond, too_fast, frozen, bounded, detector.alarm, stopped)))
        return applied, SafetyFilterState(after, applied, detector, flags)

    def _sliding(self, sound: Condition, after: Any, clean: list[Column]) -> Column:
        """Sliding variable (r,), else the velocity error."""
        p, v, _, reference_v, _ = clean
        alike = len(reference_v) == len(v)
        s = getattr(after, "s", v - reference_v if alike else Column.zeros(len(p)))
        return Column(where(sound, clip(x, -MAX_SLIDING_VARIABLE, MAX_SLIDING_VARIABLE), 0.0) for x in s)

    def _outside(self, p: Column, v: Column) -> Any:
        """1 if a joint is beyond its limits."""
        beyond: Any = 0.0
        lower, upper = self.position_limits or (np.full(self.dof, -np.inf), np.full(self.dof, np.inf))
        lower, upper = np.maximum(lower, -MAX_POSITION), np.minimum(upper, MAX_POSITION)
        for low, x, high in zip(lower.tolist(), p, upper.tolist(), strict=True):
            beyond = where(x > high, 1.0, where(x < low, 1.0, beyond))
        for x, limit in zip(v, np.asarray(self.velocity_limits).tolist(), strict=True):
            beyond = where(absolute(x) > limit, 1.0, beyond) if np.isfinite(limit) else beyond
        return beyond

    def _within_reach(self, torque: Column, memory: SafetyFilterState) -> Column:
        if not self._limits_rates:
            return torque
        steps = [minimum(rate * self.control_period, MAX_FLOAT) for rate in column(self.rate_limits)]
        pairs = zip(torque, memory.torque, steps, strict=True)
        return Column(clip(x, last - step, last + step) for x, last, step in pairs)

    def _bounded(self, after: Any) -> tuple[Any, Any]:
        """State within bounds, and 1 if it was outside."""
        if self.estimate_bounds is None:
            return after, 0.0
        estimate = Column(map(clip, after.estimate, *map(column, self.estimate_bounds)))
        return after._replace(estimate=estimate), _differ(after.estimate, estimate)


def _pair(bounds: object, size: int, what: str, each: str) -> tuple[Array, Array]:
    """Bounds (size,). Raises `InputError` unless they rise."""
    try:
        lower, upper = cast("tuple[ArrayLike, ArrayLike]", bounds)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: expected two bounds, lower and upper, got {bounds!r}") from error
    low, high = per_joint(lower, size, what), per_joint(upper, size, what)
    if not np.all(low < high):
        raise InputError(f"{what}: expected lower < upper for every {each}")
    return low, high


def _brake_damping(values: ArrayLike, dof: int) -> Array:
    damping = per_joint(values, dof, "stop_damping")
    if not np.all((damping >= 0.0) & np.isfinite(damping)):
        raise InputError(f"stop_damping: expected finite numbers of at least 0, one or {dof}, got {damping.tolist()}")
    return damping


def _bounds(law: Controller[Any], bounds: object) -> tuple[Array, Array]:
    """Bounds (k,) around the initial estimate."""
    estimate = getattr(law.initial_state(law.neutral_configuration, np.zeros(law.dof)), "estimate", None)
    if estimate is None:
        raise InputError(f"estimate_bounds: {type(law).__name__} has no estimate: omit the bounds")
    low, high = _pair(bounds, len(estimate), "estimate_bounds", "parameter")
    outside = np.flatnonzero((estimate < low) | (estimate > high))
    if outside.size:
        j = int(outside[0])
        raise InputError(
            f"estimate_bounds: the initial estimate of parameter {j} is {estimate[j]:g}, outside [{low[j]:g}, "
            f"{high[j]:g}]: start within the bounds, or widen the bounds"
        )
    return low, high


def _finite(x: Scalar) -> Condition:
    return absolute(x) <= MAX_FLOAT


def _finite_or_zero(part: Column) -> Column:
    """Numbers, 0 where not finite."""
    clean = Column(where(_finite(x), x, 0.0) for x in part)
    if isinstance(part, ClosedPositions):
        return ClosedPositions(clean, _finite_or_zero(part.configuration), part.equations)
    return clean


def _all_finite(columns: Iterable[Column]) -> Condition:
    """Condition that all are finite, by pairwise sums."""
    rest: list[Any] = [x for part in columns for x in part]
    while len(rest) > 1:
        rest = [sum(rest[k + 1 : k + 2], rest[k]) for k in range(0, len(rest), 2)]
    return _finite(rest[0])


def _differ(asked: Column, given: Column) -> Any:
    """1 if any entry differs."""
    other: Any = 0.0
    for x, y in zip(asked, given, strict=True):
        other = where(absolute(x - y) > 0.0, 1.0, other)
    return other


def _chosen(condition: Condition, yes: Parts, no: Parts) -> Parts:
    pairs = zip(yes, no, strict=True)
    return type(no)(*(_chosen(condition, a, b) if isinstance(a, tuple) else either(condition, a, b) for a, b in pairs))


def _with_applied_torque(memory: Parts, applied: Column | Array) -> Parts:
    if "torque" not in getattr(memory, "_fields", ()):
        return memory
    replaced: Parts = memory._replace(torque=applied)  # type: ignore[attr-defined]  # it has `_fields`
    return replaced


def _holding(memory: Parts, torque: Array) -> Parts:
    memory = _with_applied_torque(memory, torque)
    if "inner" not in getattr(memory, "_fields", ()):
        return memory
    replaced: Parts = memory._replace(inner=_holding(memory.inner, torque))  # type: ignore[attr-defined]  # it has `_fields`
    return replaced


def _without_learning(condition: Condition, memory: Parts) -> Parts:
    """State with no learning time under a condition."""
    parts = []
    for name, part in zip(getattr(memory, "_fields", range(len(memory))), memory, strict=True):
        if isinstance(part, tuple):
            part = _without_learning(condition, part)
        elif name == "dt":
            part = either(condition, Column.zeros(len(part)), part)
        parts.append(part)
    return type(memory)(*parts)
