"""References that tell as much of the parameters as an arm's limits allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from adaptctl.arrays import Array, frozen_array, numbers, per_joint, positive_number, real_number, whole_count
from adaptctl.caching import cached_property
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.excitation.measure import regressor_of
from adaptctl.control.references import Sinusoids
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel

SAMPLES = 40
"""Samples in a period of the highest harmonic, at which limits are held."""
FULL = 3.0
"""Argument of a logistic that stands for a share, where a search begins: 95 % of what is allowed."""
RANDOM = 10
"""references at random, to compare with"""
SMALL_PRODUCT = 200_000
"""multiplications below which OpenBLAS starts no threads"""
FARTHEST = 30.0
"""Argument of a logistic that stands for a share, beyond which it is 0 or 1 to 1e-13; it would overflow at -710."""
BISECTIONS = 20
PENALTY = 30.0
"""Weight of the square of a torque beyond its limit, against the logarithm of the condition number."""


@dataclass(frozen=True, eq=False)
class ExcitationTrajectory:
    """Optimised exciting reference (excitation trajectory), with the condition number of the torque regressor along it
    and those of random references to compare with.

    `reference` is the optimised one, in rad (m for a prismatic joint). `condition` is the condition number of the
    torque regressor stacked over a period of it, its columns scaled by the parameters' prior ranges (greatest plausible
    errors); `random_conditions` (10,) are the same of ten references drawn at random within the same limits.
    `torque_share` is the largest ratio, over time and joints, of a torque's magnitude to its limit, with the model's
    parameters. None of these numbers has a unit. `iterations` is how many the search made; `complete` is False where it
    was interrupted, and then `reference` is the best until then. Nothing is checked.
    """

    reference: Sinusoids
    condition: float
    random_conditions: Array
    torque_share: float
    iterations: int
    complete: bool
    """False when it was interrupted: the best that was found is kept."""

    @property
    def gain(self) -> float:
        """Ratio, without a unit, of two condition numbers: the median of those of ten random references (the field
        `random_conditions`) over that of the optimised reference (the field `condition`). Each is the condition number
        of the torque regressor stacked over a period of the reference, its columns scaled by the parameters' prior
        ranges (greatest plausible errors). Above 1 the optimised reference is the better conditioned one."""
        return float(np.median(self.random_conditions)) / self.condition


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a reference for r joints: positions from `lower` to `upper` in rad (m for a prismatic joint), greatest
    speeds `velocity` in rad/s (m/s) and torques `torque` in N m (N), (r,) each; the last two infinite where there is
    none. Nothing is checked here; `excitation_trajectory` checks them."""

    lower: Array
    upper: Array
    velocity: Array
    torque: Array

    @classmethod
    def of(cls, model: ReducedModel, share: float) -> MotionLimits:
        """Motion limits, a `MotionLimits`, at a fraction `share`, without a unit, above 0 and up to 1, of the own
        limits of the r joints in `model`. Positions (r,) are about the middle of their range, in rad (m for a prismatic
        joint), speeds in rad/s (m/s) and torques in N m (N). A lower position limit that a joint lacks is taken as the
        lesser of -pi rad (-1 m) and its upper limit less 2 pi rad (2 m), an upper one as the greater of pi rad (1 m)
        and its lower limit plus 2 pi rad (2 m); speeds and torques without a limit are infinite. Raises `InputError`
        for another `share`."""
        _validate_share(share)
        joints = model.mechanism.primary_joints
        wide = np.array([np.pi if joint.kind.is_revolute else 1.0 for joint in joints])
        lower, upper = (np.array([getattr(j.limits, name) for j in joints]) for name in ("lower", "upper"))
        lower = np.where(np.isfinite(lower), lower, np.minimum(-wide, upper - 2.0 * wide))
        upper = np.where(np.isfinite(upper), upper, np.maximum(wide, lower + 2.0 * wide))
        middle, half = 0.5 * (lower + upper), 0.5 * share * (upper - lower)
        velocity = share * np.array([joint.limits.velocity for joint in joints])
        return cls(middle - half, middle + half, velocity, share * model.mechanism.effort_limits)


@dataclass(frozen=True, eq=False)
class FourierSearch:
    """Search for an exciting reference (excitation trajectory): a periodic motion of the `model`'s r joints within
    `limits`, along which the model's k parameters can be identified best. It is a Fourier series of `harmonics`
    harmonics of `frequency` (Hz).

    The search is over vectors x (`size`,) without bounds or units, r (2 h + 2) numbers for h harmonics, in this order:
    coefficients of the sines (h, r), row by row, then of the cosines (h, r), both divided by the harmonic's number when
    used; then r numbers whose logistic function is the fraction of each joint's limits that is used, and r whose
    logistic function is the position of the swing between the position limits, from 0 at the lower to 1 at the upper
    one. Minimised is the condition number of the torque regressor, its columns scaled by `scale` (k,), the parameters'
    prior ranges (greatest plausible errors) in SI units. Nothing is checked here: `excitation_trajectory` checks, and
    searches.
    """

    model: ReducedModel
    limits: MotionLimits
    frequency: float
    harmonics: int
    scale: Array

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary (independent) joints, which the reference moves."""
        return self.model.mechanism.dof

    @property
    def size(self) -> int:
        """Length of the vectors that are searched: r (2 h + 2) for r joints and h harmonics."""
        return self.dof * (2 * self.harmonics + 2)

    def random(self, rng: np.random.Generator) -> Array:
        """A random vector of the search, r (2 h + 2) numbers without units for r joints and h harmonics, drawn from the
        generator `rng`. All are standard normal but the r that set the fraction of each joint's limits that is used:
        these are 3, for 95 %. Nothing is checked."""
        coefficients = rng.normal(size=2 * self.harmonics * self.dof)
        return np.concatenate((coefficients, np.full(self.dof, FULL), rng.normal(size=self.dof)))

    def motion(self, x: Array, factor: float = 1.0) -> tuple[Array, Array, Array]:
        """Positions in rad (m if prismatic), velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2), (n, r)
        each, of r joints over one period of the reference that a vector `x` of the search stands for. `x` has r (2 h +
        2) numbers for h harmonics; n = 40 h samples are evenly spaced from the period's start on. The swing about the
        centre is multiplied by `factor`, 1 by default. Nothing is checked."""
        y, rate, bend = self._swing(*self._coefficients(x))
        used, center = self._fitted(x, y, rate, factor)
        return center + used * y, used * rate, used * bend

    def reference(self, x: Array, factor: float = 1.0) -> Sinusoids:
        """The periodic reference of r joints that a vector `x` of the search stands for, as `Sinusoids` without
        fade-in. `x` has r (2 h + 2) numbers for h harmonics; the swing about the centre is multiplied by `factor`, 1 by
        default. For factors up to 1 positions and speeds are within their limits by construction, at 40 samples a
        period of the highest harmonic; torques may be beyond theirs. Nothing is checked."""
        sine, cosine = self._coefficients(x)
        y, rate, _ = self._swing(sine, cosine)
        used, center = self._fitted(x, y, rate, factor)
        amplitude, phase = used * np.hypot(sine, cosine), np.arctan2(cosine, sine)
        frequency = np.broadcast_to(self.frequency * self._order, sine.shape)
        return Sinusoids(center, amplitude, frequency, phase, start_time=0.0)

    def judged(self, x: Array, factor: float = 1.0) -> tuple[float, float]:
        """Two numbers without units for the reference that a vector `x` of r (2 h + 2) numbers stands for, with r
        joints and h harmonics. The first is the condition number of the torque regressor stacked over a period, its
        columns scaled by the parameters' prior ranges (greatest plausible errors); the second the largest ratio, over
        time and joints, of a torque's magnitude to its limit, with the model's own parameters. The swing about the
        centre is multiplied by `factor`, 1 by default. Nothing is checked."""
        Y = self._along(x, factor)
        eigenvalues = np.linalg.eigvalsh(_gram(Y * self.scale))
        smallest = max(float(eigenvalues[0]), 1e-30 * float(eigenvalues[-1]))
        return float(np.sqrt(eigenvalues[-1] / smallest)), self._share(Y)

    def torque_share(self, x: Array, factor: float) -> float:
        """The largest ratio, over time and joints, of a torque's magnitude to its limit, without a unit, along the
        reference that a vector `x` of the search stands for, with the model's own parameters. `x` has r (2 h + 2)
        numbers for r joints and h harmonics; the swing about the centre is multiplied by `factor`. Nothing is
        checked."""
        return self._share(self._along(x, factor))

    def cost(self, x: Array) -> float:
        """The cost ln(c) + 30 max(0, t - 1)^2, without a unit, that the search minimises, at a vector `x` of r (2 h +
        2) numbers for r joints and h harmonics. c is the condition number of the torque regressor stacked over a period
        of the reference, columns scaled by the parameters' prior ranges (greatest plausible errors), and t the largest
        ratio of a torque's magnitude to its limit. Nothing is checked."""
        condition, share = self.judged(x)
        return float(np.log(condition) + PENALTY * max(0.0, share - 1.0) ** 2)

    def within(self, x: Array) -> tuple[Sinusoids, float, float]:
        """The reference that a vector `x` of r (2 h + 2) numbers stands for, r the joints and h the harmonics, as
        `Sinusoids`, its swing about the centre made smaller where torques would pass their limits. Two numbers without
        a unit come after it: the condition number of the torque regressor stacked over a period, columns scaled by the
        parameters' prior ranges (greatest plausible errors), and the largest ratio of a torque's magnitude to its
        limit. Raises `InputError` where torques pass their limits even at rest."""
        factor = 1.0
        if self.torque_share(x, 1.0) > 1.0:
            if self.torque_share(x, 0.0) > 1.0:
                raise InputError(
                    f"{self.model.mechanism.name}: even at rest torques pass their limits within the joints' ranges: "
                    "narrow the ranges, or raise the torque limits"
                )
            low, high = 0.0, 1.0
            for _ in range(BISECTIONS):
                factor = 0.5 * (low + high)
                low, high = (factor, high) if self.torque_share(x, factor) <= 1.0 else (low, factor)
            factor = low
        return self.reference(x, factor), *self.judged(x, factor)

    def _coefficients(self, x: Array) -> tuple[Array, Array]:
        """Coefficients of the sines and cosines (h, r); higher harmonics begin with smaller swings."""
        sine, cosine = x[: -2 * self.dof].reshape(2, self.harmonics, self.dof) / self._order
        return sine, cosine

    def _swing(self, sine: Array, cosine: Array) -> tuple[Array, Array, Array]:
        """The swing (n, r) about the centre, its rate and its rate's, before any limit."""
        S, C = self._waves
        omega = 2.0 * np.pi * self.frequency * self._order
        y, bend = S @ sine + C @ cosine, -(S @ (omega**2 * sine) + C @ (omega**2 * cosine))
        return y, C @ (omega * sine) - S @ (omega * cosine), bend

    def _fitted(self, x: Array, y: Array, rate: Array, factor: float) -> tuple[Array, Array]:
        """Factor (r,) of the swing that is used, and centre (r,) that it is about."""
        reach, speed = np.ptp(y, axis=0), np.abs(rate).max(axis=0)
        room = self.limits.upper - self.limits.lower
        use, place = (_logistic(part) for part in x[-2 * self.dof :].reshape(2, -1))
        used = factor * use * np.minimum(room / reach, self.limits.velocity / speed)
        return used, self.limits.lower - used * y.min(axis=0) + place * (room - used * reach)

    def _along(self, x: Array, factor: float) -> Array:
        """The regressor (n, r, k) along the motion."""
        p, v, a = self.motion(x, factor)
        return self._regressor(p, v, v, a)

    def _share(self, Y: Array) -> float:
        return float((np.abs(Y @ self.model.fundamental_parameters) / self.limits.torque).max())

    @cached_property
    def _order(self) -> Array:
        return np.arange(1.0, self.harmonics + 1.0)[:, None]

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        """Sines and cosines (n, h) over a period."""
        turns = np.arange(SAMPLES * self.harmonics)[:, None] / (SAMPLES * self.harmonics)
        angle = 2.0 * np.pi * turns * self._order.T
        return np.sin(angle), np.cos(angle)

    @cached_property
    def _regressor(self) -> Callable[[Array, Array, Array, Array], Array]:
        return regressor_of(self.model)


def excitation_trajectory(
    model: ReducedModel,
    *,
    frequency: float = 0.1,
    harmonics: int = 5,
    limit_share: float = 0.8,
    scale: ArrayLike | None = None,
    limits: MotionLimits | None = None,
    iterations: int = 100,
    seed: int = 0,
    progress: Callable[[float], object] | None = None,
) -> ExcitationTrajectory:
    """The periodic reference of the `model`'s r joints with the least condition number of the torque regressor that a
    search finds, an `ExcitationTrajectory`. It has harmonics 1 to `harmonics` (5 by default) of `frequency` (Hz, 0.1 by
    default).

    Fourier series within positions, speeds and torques (Swevers, Ganseman, Tukel, De Schutter and Van Brussel 1997):
    within `limits`, or where these are None a fraction `share` (above 0 to 1, 0.8 by default) of the joints' own.
    Torques are those of the model's own parameters; where these are only guessed, give lower torque limits. `scale`
    (k,), SI units, or one number are the prior ranges (greatest plausible errors) of the model's k parameters, by which
    the regressor's columns are scaled, those of `PriorRanges` where None. The search (L-BFGS, at most `iterations`, 100
    by default) begins at the best of ten random references, drawn by the integer `seed` of at least 0; equal seeds find
    equal references.

    `progress` is called after each iteration with the fraction done, 0 to 1; None calls nothing. Ctrl-C ends the search
    with the best reference so far, flagged as not complete. Raises `InputError` unless the frequency is positive,
    `harmonics` and `iterations` are whole numbers of at least 1, the seed one of at least 0, the share above 0 and up
    to 1 and the scale positive, finite and of its shape; for `limits` of another shape, with NaN, crossed or infinite
    positions, speeds below 0 or torques not above it; and where torques pass their limits even at rest.
    """
    iterations = whole_count(iterations, "iterations", 1)
    search = _checked(model, frequency, harmonics, limit_share, scale, limits)
    rng = np.random.default_rng(whole_count(seed, "seed"))
    starts = [search.random(rng) for _ in range(RANDOM)]
    random_conditions = np.array([search.within(x)[1] for x in starts])
    best = _Best(search, starts[int(np.argmin([search.cost(x) for x in starts]))], iterations, progress)
    complete = True
    try:
        options = {"maxiter": iterations, "maxfun": 100 * iterations * search.size}
        minimize(best.cost, best.x, method="L-BFGS-B", callback=best.iterated, options=options)  # type: ignore[call-overload]  # in no stub
    except KeyboardInterrupt:
        complete = False
    reference, condition, torque_share = search.within(best.x)
    return ExcitationTrajectory(reference, condition, random_conditions, torque_share, best.iterations, complete)


class _Best:
    """The best vector that a search has met, and how far the search is."""

    def __init__(self, search: FourierSearch, x: Array, most: int, progress: Callable[[float], object] | None) -> None:
        self.search, self.x, self.lowest = search, x, search.cost(x)
        self.iterations, self._most, self._progress = 0, most, progress

    def cost(self, x: Array) -> float:
        """The search's cost, remembered where it is the lowest."""
        value = self.search.cost(x)
        if value < self.lowest:
            self.x, self.lowest = x.copy(), value
        return value

    def iterated(self, x: Array) -> None:
        """Called after an iteration."""
        self.iterations += 1
        if self._progress is not None:
            self._progress(min(1.0, self.iterations / self._most))


def _checked(
    model: ReducedModel,
    frequency: float,
    harmonics: int,
    share: float,
    scale: ArrayLike | None,
    limits: MotionLimits | None,
) -> FourierSearch:
    """The search with these settings. Raises `InputError` for those that cannot be."""
    frequency = positive_number(frequency, "frequency: expected a positive one in Hz")
    harmonics = whole_count(harmonics, "harmonics", 1)
    _validate_share(share)
    if limits is not None:
        _validate_limits(limits, model.mechanism.dof)
    k = len(model.columns)
    ranges = PriorRanges().of(model.names) if scale is None else numbers(scale, "scale")
    ranges = frozen_array(np.broadcast_to(ranges, (k,)) if ranges.ndim == 0 else ranges, (k,), "scale")
    if not np.all(ranges > 0.0):
        raise InputError(f"scale: expected positive numbers, got {ranges.tolist()}")
    return FourierSearch(model, limits or MotionLimits.of(model, share), frequency, harmonics, ranges)


def _validate_share(share: float) -> None:
    if not 0.0 < real_number(share, "limit_share") <= 1.0:
        raise InputError(f"limit_share: expected a share of the limits above 0 and up to 1, got {share}")


def _validate_limits(limits: MotionLimits, dof: int) -> None:
    """Raise `InputError` for limits that no reference keeps."""
    lower, upper = (frozen_array(getattr(limits, name), (dof,), f"limits: {name}") for name in ("lower", "upper"))
    if not np.all(lower <= upper):
        raise InputError(f"limits: expected lower <= upper for every joint, got {lower.tolist()} and {upper.tolist()}")
    velocity, torque = (per_joint(getattr(limits, name), dof, f"limits: {name}") for name in ("velocity", "torque"))
    if not np.all(velocity >= 0.0):
        raise InputError(f"limits: velocity: expected numbers of at least 0, got {velocity.tolist()}")
    if not np.all(torque > 0.0):
        raise InputError(f"limits: torque: expected positive numbers, got {torque.tolist()}")


def _gram(Y: Array) -> Array:
    """Y'Y (k, k) of all samples of Y (n, r, k), in products too small for threads, which would cost more to start."""
    samples, rows, k = Y.shape
    together = max(1, SMALL_PRODUCT // (rows * k * k))
    whole = samples // together * together
    parts = Y[:whole].reshape(-1, together * rows, k)
    rest = Y[whole:].reshape(-1, k)
    return np.asarray(np.sum(np.swapaxes(parts, 1, 2) @ parts, axis=0) + rest.T @ rest)


def _logistic(x: Array) -> Array:
    """1/(1 + exp(-x)) of any x, above 0 and at most 1: a search may walk however far."""
    return 1.0 / (1.0 + np.exp(-np.clip(x, -FARTHEST, FARTHEST)))
