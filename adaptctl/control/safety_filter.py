"""Guards of a controller before it may touch a motor: limits it knows, learning that waits, a safe stop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_per_joint
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.gains.sampling_ratio import validate_period
from adaptctl.control.pytree import leaves, row_each
from adaptctl.control.ringing import Ringing
from adaptctl.dynamics.equations import ClosedPositions
from adaptctl.errors import InputError, validate_kind
from adaptctl.scalars import Column, Scalar, absolute, clip, column, maximum, minimum, where
from adaptctl.scalars.scalar import Condition

LOUD = 1e6
"""rad/s (m/s): a sliding variable is taken as no larger, so that its square stays finite"""
LARGEST = float(np.finfo(np.float64).max)

Parts = TypeVar("Parts", bound=tuple[Any, ...])


class SafetyFlags(NamedTuple):
    """Flags, each (1,), of what the guards of a controller did in one control period: 1 where the guard acted and 0
    where not.

    `torque_limited`: a torque was beyond its limit; `rate_limited`: a torque would have changed faster than its limit;
    `frozen`: nothing is learned from the period that begins; `bounded`: an estimate was brought back to its bounds;
    `ringing`: a joint's sliding variable (or velocity error, where the law has none) changes its sign from one control
    period to the next, its correlation with itself one period ago having been below -0.5 for 25 periods in a row;
    `stopped`: the arm is braked, now and in all control periods after, until `init` makes a new state. Nothing is
    checked.
    """

    torque_limited: Any
    rate_limited: Any
    frozen: Any
    bounded: Any
    ringing: Any
    stopped: Any
    """something was not finite, out of bounds or ringing beyond help, now or before: the arm is braked"""


class SafetyFilterState(NamedTuple):
    """Internal state of a controller behind guards, for r joints. `of` is the wrapped law's own internal state;
    `torque` (r,) the last torque given out, N m (N if prismatic), before the first control period the one that is
    applied then; `heard` the detector of ringing, moving averages over the sliding variable, rad/s (m/s); and `flags`
    the flags, (1,) each, 1 for each guard (limit, bound or brake) that acted in the last control period, else 0.
    Nothing is checked."""

    inner: Any
    torque: Any
    ringing: Ringing
    flags: SafetyFlags

    @property
    def estimate(self) -> Any:
        """The wrapped law's estimate (k,) of its k parameters, in their SI units. Raises `AttributeError` for a law
        without an estimate."""
        return self.inner.estimate

    @property
    def logged_state(self) -> Any:
        """Array of the wrapped adaptation law's internal state that is stored with each sample of a recorded run. For
        `ConcurrentLearning` it is (..., 1): 1 where the last period's sample was kept and 0 where not. For
        `CompositeLearning` it is (..., 1): the number, 0 to r, of the r joints whose torque equation was learned from.
        For `ConsistentAdaptation` it is (..., P): the P inertial and friction parameters, SI units, whose fundamental
        (base) parameters are the estimate. Raises `AttributeError` for all other laws."""
        return self.inner.logged_state


@dataclass(frozen=True, eq=False)
class SafetyFilter(Controller[SafetyFilterState]):
    """A controller behind guards: limits of its torque, of the torque's rate and of its estimate, and a brake where
    numbers are not finite.

    The controller is `of`, a law for r joints. Torques stay within `torque_limits` (N m, N for a prismatic joint) and
    change by at most `rate_limits` (N m/s, N/s) times `period` (s; None is the law's own) from one control period to
    the next, in the first from the torque that `init` is told of, zero unless the arm is held by another; limits are
    infinite, that is off, unless given. While either limits the torque, the
    tracking error is not caused by the estimate, and nothing is learned from that period (unless `freeze` is False): an
    integrator's anti-windup by conditional integration (Astrom and Hagglund, Advanced PID Control, 2006, section 3.5).
    Estimates of the law's k parameters stay within `estimate_bounds`, lower and upper, one number or (k,) each, SI
    units, none where None.

    The arm is braked by `stop_damping` (N m s/rad or N s/m; None is the law's own damping) from the first of these on,
    until `init` makes a new state: a measurement, a reference, or anything that the law makes of them is not finite; a
    joint is outside `position_limits`, lower and upper (r,) in rad (m), none where None, or faster than
    `velocity_limits` (rad/s or m/s); or a joint rings, which is a correlation of its sliding variable (its velocity
    error where the law has none) with itself one control period ago below -0.9 for 25 control periods in a row. Gravity
    is not compensated then: a mechanical brake must hold the arm. Limits and damping are one number or (r,), one for
    each joint.

    What the guards do in a control period is in the internal state's field `flags`. Raises `InputError` for limits that
    are not positive, limits and bounds of another shape, bounds and position limits that are no pair or whose lower end
    is not below the upper, an initial estimate out of bounds, bounds for a law that estimates nothing, a damping below
    0, a period that is not positive, and where neither the law nor the arguments give a damping or, for finite
    `rate_limits`, a period; `NonFiniteError` for NaN in any of these numbers but the period, which raises `InputError`.
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
        validate_kind(self.inner, Controller, "guarded", "as SlotineLi(...) is one")
        if not isinstance(self.freeze, bool):
            raise InputError(f"freeze: expected True or False, got {self.freeze!r}")
        for name in ("torque_limits", "rate_limits", "velocity_limits"):
            object.__setattr__(self, name, positive_per_joint(getattr(self, name), self.dof, name, infinite=True))
        own = getattr(self.inner, "damping", None) if self.stop_damping is None else self.stop_damping
        if own is None:
            raise InputError(
                f"stop_damping: {type(self.inner).__name__} has no damping of its own to brake by: give one"
            )
        object.__setattr__(self, "stop_damping", _brake(own, self.dof))
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
                f"control_period: {type(self.inner).__name__} does not know its own, and limiting rates needs it"
            )
        if self.estimate_bounds is not None:
            object.__setattr__(self, "estimate_bounds", _bounds(self.inner, self.estimate_bounds))

    @property
    def tunable(self) -> tuple[str, ...]:
        """Names of the attributes whose numbers can be changed without compiling the law again: `torque_limits`,
        `stop_damping`, `estimate_bounds`, and `rate_limits` where any is finite."""
        rates = ("rate_limits",) if self._limits_rates else ()
        return ("torque_limits", "stop_damping", "estimate_bounds", *rates)

    @property
    def _limits_rates(self) -> bool:
        limited = isinstance(self.rate_limits, Column) or bool(np.isfinite(np.asarray(self.rate_limits)).any())
        return limited and self.control_period is not None

    @property
    def dof(self) -> int:
        """Number r of joints that the wrapped control law, the attribute `of`, moves."""
        return self.inner.dof

    @property
    def neutral_configuration(self) -> Array:
        """Home positions (r,) of the r joints, rad (m if prismatic), those of the wrapped control law: a configuration
        at which the law can be evaluated, such as one that closes kinematic loops, and at which it is compiled. They
        are not limits, nor where a run must start."""
        return self.inner.neutral_configuration

    @property
    def reference_size(self) -> int:
        """Length of each part (positions, velocities or accelerations) of the wrapped law's reference points: r for
        joints, or the number d of task-space coordinates."""
        return self.inner.reference_size

    def initial_state(self, p: Array, v: Array) -> SafetyFilterState:
        """The internal state before the first control period, a `SafetyFilterState`: the wrapped law's own state, zero
        torque, and zero for all flags of what the guards did. Arms are at positions `p` (..., r), rad (m if prismatic),
        and velocities `v` (..., r), rad/s (m/s), of r joints. Raises what the wrapped law's method `start` does."""
        flags = SafetyFlags(*(np.zeros(1) for _ in SafetyFlags._fields))
        return SafetyFilterState(self.inner.initial_state(p, v), np.zeros(self.dof), Ringing.zero(self.dof), flags)

    def init(
        self, p: ArrayLike, v: ArrayLike, gains: Mapping[str, Array] | None = None, torque: ArrayLike | None = None
    ) -> SafetyFilterState:
        """The internal state before the first control period, as of any controller. `torque` (..., r), N m (N if
        prismatic), is the one that is applied to the r joints now, from which limited rates count: None is zero, for an
        arm that nothing drives or that compensates its gravity itself; an arm that is held by a torque, such as
        gravity's, needs that one. Raises what `init` of other controllers does, and for `torque` `InputError` on a
        wrong shape and `NonFiniteError` where it is not finite."""
        state = super().init(p, v, gains)
        if torque is None:
            return state
        arms = np.shape(p)[:-1]
        applied = row_each(self._measured(torque, "torque"), arms, "torque")
        return self._remembering(self._array_of(_holding(state, applied), arms))

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: SafetyFilterState
    ) -> tuple[Column, SafetyFilterState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, within the limits of
        torque and rate, and the internal state after it. Positions `p` (r,), rad (m), and velocities `v` (r,), rad/s
        (m/s), are measured; `reference` is the wrapped law's reference point: desired positions, velocities and
        accelerations (r,), in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic), or those of task-space
        coordinates, `memory` the internal state of the last control period. NaN and infinity raise nothing: the wrapped
        law is given 0 in their place, and the arm is braked. Shapes are not checked here: the method `step` checks
        them."""
        given = (p, v, *reference)
        clean = list(map(_cleaned, given))
        torque, after = self.inner.law(clean[0], clean[1], ReferencePoint(*clean[2:]), memory.inner)
        after, bounded = self._bounded(after)
        sound = _sound((*given, torque, *leaves(after)))
        heard = memory.ringing.updated(self._sliding(sound, after, clean))
        lost = maximum(self._outside(clean[0], clean[1]), heard.brake)
        stopped = where(sound, maximum(memory.flags.stopped[0], lost), 1.0)
        torque = _either(stopped > 0.5, -(column(self.stop_damping) * clean[1]), torque)
        after = _chosen(stopped > 0.5, memory.inner, after)
        limits = Column(minimum(limit, LARGEST) for limit in column(self.torque_limits))
        limited = Column(map(clip, torque, -limits, limits))
        applied = self._within_reach(limited, memory)
        beyond, too_fast = _differ(torque, limited), _differ(limited, applied)
        frozen = maximum(beyond, too_fast) if self.freeze else 0.0
        after = _with_applied_torque(after, applied)
        after = _without_learning(frozen > 0.5, after) if self.freeze else after
        flags = SafetyFlags(*(Column((flag,)) for flag in (beyond, too_fast, frozen, bounded, heard.alarm, stopped)))
        return applied, SafetyFilterState(after, applied, heard, flags)

    def _sliding(self, sound: Condition, after: Any, clean: list[Column]) -> Column:
        """The law's sliding variable (r,), or the error of velocities where it has none; 0 where that is not sound."""
        p, v, _, reference_v, _ = clean
        alike = len(reference_v) == len(v)
        s = getattr(after, "s", v - reference_v if alike else Column.zeros(len(p)))
        return Column(where(sound, clip(x, -LOUD, LOUD), 0.0) for x in s)

    def _outside(self, p: Column, v: Column) -> Any:
        """1 where a joint is beyond a limit of position or velocity, else 0."""
        beyond: Any = 0.0
        lower, upper = self.position_limits or (np.full(self.dof, -np.inf), np.full(self.dof, np.inf))
        for low, x, high in zip(np.asarray(lower).tolist(), p, np.asarray(upper).tolist(), strict=True):
            beyond = where(x < low, 1.0, beyond) if np.isfinite(low) else beyond
            beyond = where(x > high, 1.0, beyond) if np.isfinite(high) else beyond
        for x, limit in zip(v, np.asarray(self.velocity_limits).tolist(), strict=True):
            beyond = where(absolute(x) > limit, 1.0, beyond) if np.isfinite(limit) else beyond
        return beyond

    def _within_reach(self, torque: Column, memory: SafetyFilterState) -> Column:
        """The nearest torque that the rate allows."""
        if not self._limits_rates:
            return torque
        steps = [minimum(rate * self.control_period, LARGEST) for rate in column(self.rate_limits)]
        pairs = zip(torque, memory.torque, steps, strict=True)
        return Column(clip(x, last - step, last + step) for x, last, step in pairs)

    def _bounded(self, after: Any) -> tuple[Any, Any]:
        """The memory with its estimate within the bounds, and whether it had to be brought there."""
        if self.estimate_bounds is None:
            return after, 0.0
        estimate = Column(map(clip, after.estimate, *map(column, self.estimate_bounds)))
        return after._replace(estimate=estimate), _differ(after.estimate, estimate)


def _pair(bounds: object, size: int, what: str, each: str) -> tuple[Array, Array]:
    """Lower and upper bounds (size,), from one number for all or one each. Raises `InputError` unless they rise."""
    try:
        lower, upper = cast("tuple[ArrayLike, ArrayLike]", bounds)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: expected two bounds, lower and upper, got {bounds!r}") from error
    low, high = per_joint(lower, size, what), per_joint(upper, size, what)
    if not np.all(low < high):
        raise InputError(f"{what}: expected lower < upper for every {each}")
    return low, high


def _brake(values: ArrayLike, dof: int) -> Array:
    """A brake's damping (r,) of at least 0 N m s/rad, one for all joints or one each."""
    damping = per_joint(values, dof, "stop_damping")
    if not np.all((damping >= 0.0) & np.isfinite(damping)):
        raise InputError(f"stop_damping: expected finite numbers of at least 0, one or {dof}, got {damping.tolist()}")
    return damping


def _bounds(law: Controller[Any], bounds: object) -> tuple[Array, Array]:
    """Bounds (k,) of a law's estimate, which must start within them."""
    estimate = getattr(law.initial_state(law.neutral_configuration, np.zeros(law.dof)), "estimate", None)
    if estimate is None:
        raise InputError(f"estimate_bounds: {type(law).__name__} estimates nothing: leave them out")
    low, high = _pair(bounds, len(estimate), "estimate_bounds", "parameter")
    outside = np.flatnonzero((estimate < low) | (estimate > high))
    if outside.size:
        j = int(outside[0])
        raise InputError(
            f"estimate_bounds: the first estimate of parameter {j} is {estimate[j]:g}, outside [{low[j]:g}, "
            f"{high[j]:g}]: start within the bounds, or widen them"
        )
    return low, high


def _finite(x: Scalar) -> Condition:
    return absolute(x) <= LARGEST


def _cleaned(part: Column) -> Column:
    """The numbers with 0 for those that are not finite, and so the closed configuration, if they come with one."""
    clean = Column(where(_finite(x), x, 0.0) for x in part)
    if isinstance(part, ClosedPositions):
        return ClosedPositions(clean, _cleaned(part.configuration), part.equations)
    return clean


def _sound(columns: Iterable[Column]) -> Condition:
    """Condition that all numbers are finite: their sum is, for what is not finite stays so. Added in pairs, so that
    few additions wait for others."""
    rest: list[Any] = [x for part in columns for x in part]
    while len(rest) > 1:
        rest = [sum(rest[k + 1 : k + 2], rest[k]) for k in range(0, len(rest), 2)]
    return _finite(rest[0])


def _differ(asked: Column, given: Column) -> Any:
    """1 where any entry is another, else 0."""
    other: Any = 0.0
    for x, y in zip(asked, given, strict=True):
        other = where(absolute(x - y) > 0.0, 1.0, other)
    return other


def _either(condition: Condition, yes: Column, no: Column) -> Column:
    return Column(where(condition, x, y) for x, y in zip(yes, no, strict=True))


def _chosen(condition: Condition, yes: Parts, no: Parts) -> Parts:
    """One of two memories of a kind."""
    pairs = zip(yes, no, strict=True)
    return type(no)(*(_chosen(condition, a, b) if isinstance(a, tuple) else _either(condition, a, b) for a, b in pairs))


def _with_applied_torque(memory: Parts, applied: Column | Array) -> Parts:
    """The internal state of a law that remembers its torque, with the one that is applied."""
    if "torque" not in getattr(memory, "_fields", ()):
        return memory
    replaced: Parts = memory._replace(torque=applied)  # type: ignore[attr-defined]  # it has `_fields`
    return replaced


def _holding(memory: Parts, torque: Array) -> Parts:
    """The internal state of a law, and of those within its guards, with the torque that is applied."""
    memory = _with_applied_torque(memory, torque)
    if "inner" not in getattr(memory, "_fields", ()):
        return memory
    replaced: Parts = memory._replace(inner=_holding(memory.inner, torque))  # type: ignore[attr-defined]  # it has `_fields`
    return replaced


def _without_learning(condition: Condition, memory: Parts) -> Parts:
    """The memory whose laws take no time to have elapsed, where the condition holds: they learn nothing then."""
    parts = []
    for name, part in zip(getattr(memory, "_fields", range(len(memory))), memory, strict=True):
        if isinstance(part, tuple):
            part = _without_learning(condition, part)
        elif name == "dt":
            part = _either(condition, Column.zeros(len(part)), part)
        parts.append(part)
    return type(memory)(*parts)
