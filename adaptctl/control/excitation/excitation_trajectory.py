"""Excitation trajectories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, positive_number, whole_count
from adaptctl.caching import cached_property
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.excitation.measure import regressor_of
from adaptctl.control.excitation.motion_limits import MotionLimits, validate_limits, validate_share
from adaptctl.control.references import Sinusoids
from adaptctl.errors import InputError, validate_kind
from adaptctl.identifiability import ReducedModel

SAMPLES_PER_PERIOD = 40  # of the highest harmonic, at which limits are kept
INITIAL_LOGIT = 3.0  # the search begins at 95 % of what is allowed
RANDOM_REFERENCES = 10  # for comparison
MAX_UNTHREADED_PRODUCT = 200_000  # multiplications below which OpenBLAS starts no threads
MAX_LOGIT = 30.0  # the logistic is 0 or 1 to 1e-13 beyond, and would overflow at -710
BISECTIONS = 20
INDEPENDENT_ROW_RATE = 50.0  # Hz; at a higher rate the errors of an identification are correlated
TORQUE_PENALTY = 30.0  # on the squared excess, against the logarithm of the condition number

Motion = tuple[Array, Array, Array]
"""Positions, velocities and accelerations (n, r), at 50 Hz"""


@dataclass(frozen=True, eq=False)
class ExcitationTrajectory:
    """
    Optimised excitation trajectory, and random references that it is compared with.

    Parameters
    ----------
    reference : Sinusoids
        Optimised reference.
    condition : float
        Condition number of the regressor over one period, its columns scaled by prior ranges. 1 is best.
    random_conditions : ndarray
        Condition numbers (10,) of random references within the same limits.
    torque_share : float
        Largest ratio of a torque to its limit, at most 1.
    iterations : int
        Iterations that the search took.
    complete : bool
        False if the search was interrupted; the reference is then the best so far.

    Examples
    --------
    >>> found = adaptctl.control.excitation_trajectory(model, harmonics=2, iterations=1)
    >>> found.complete, found.random_conditions.shape
    (True, (10,))
    """

    reference: Sinusoids
    condition: float
    random_conditions: Array
    torque_share: float
    iterations: int
    complete: bool

    @property
    def condition_improvement(self) -> float:
        """Median condition number of the random references divided by that of the optimised one."""
        return float(np.median(self.random_conditions)) / self.condition


@dataclass(frozen=True, eq=False)
class FourierSearch:
    """Search for Fourier series: sines, cosines, use of limits, centre."""

    model: ReducedModel
    limits: MotionLimits
    frequency: float
    harmonics: int
    scale: Array
    earlier: Motion | None = None

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary joints."""
        return self.model.mechanism.dof

    @property
    def size(self) -> int:
        """Length r (2 h + 2) of the vectors."""
        return self.dof * (2 * self.harmonics + 2)

    def random(self, rng: np.random.Generator) -> Array:
        """Random vector, 95 % of the limits."""
        coefficients = rng.normal(size=2 * self.harmonics * self.dof)
        return np.concatenate((coefficients, np.full(self.dof, INITIAL_LOGIT), rng.normal(size=self.dof)))

    def motion(self, x: Array, factor: float = 1.0) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (n, r) over a period."""
        y, rate, bend = self._swing(*self._coefficients(x))
        used, center = self._fitted(x, y, rate, factor)
        return self._along_joints(center + used * y), self._along_joints(used * rate), self._along_joints(used * bend)

    def reference(self, x: Array, factor: float = 1.0) -> Sinusoids:
        """Sinusoids of a vector, within position and speed limits."""
        sine, cosine = self._coefficients(x)
        y, rate, _ = self._swing(sine, cosine)
        used, center = self._fitted(x, y, rate, factor)
        sine, cosine = self._along_joints(used * sine), self._along_joints(used * cosine)
        frequency = np.broadcast_to(self.frequency * self._order, sine.shape)
        amplitude, phase = np.hypot(sine, cosine), np.arctan2(cosine, sine)
        return Sinusoids(self._along_joints(center), amplitude, frequency, phase, start_time=0.0)

    def judged(self, x: Array, factor: float = 1.0) -> tuple[float, float]:
        """Condition number and torque share."""
        Y = self._along(x, factor)
        eigenvalues = np.linalg.eigvalsh(_gram(Y * self.scale) + len(Y) * self.frequency * self._known)
        smallest = max(float(eigenvalues[0]), 1e-30 * float(eigenvalues[-1]))
        return float(np.sqrt(eigenvalues[-1] / smallest)), self._share(Y)

    def torque_share(self, x: Array, factor: float) -> float:
        """Largest torque over its limit."""
        return self._share(self._along(x, factor))

    def cost(self, x: Array) -> float:
        """Logarithm of the condition plus torque penalty."""
        condition, share = self.judged(x)
        return float(np.log(condition) + TORQUE_PENALTY * max(0.0, share - 1.0) ** 2)

    def within(self, x: Array) -> tuple[Sinusoids, float, float]:
        """Reference within torque limits, condition and torque share."""
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

    def _along_joints(self, u: Array) -> Array:
        """Values (..., r) of the joints, from those of the limits' coordinates."""
        return u if self.limits.axes is None else np.asarray(u @ self.limits.axes.T)

    def _coefficients(self, x: Array) -> tuple[Array, Array]:
        """Sines and cosines (h, r)."""
        sine, cosine = x[: -2 * self.dof].reshape(2, self.harmonics, self.dof) / self._order
        return sine, cosine

    def _swing(self, sine: Array, cosine: Array) -> tuple[Array, Array, Array]:
        """Swing (n, r) and its two derivatives."""
        S, C = self._waves
        omega = 2.0 * np.pi * self.frequency * self._order
        y, bend = S @ sine + C @ cosine, -(S @ (omega**2 * sine) + C @ (omega**2 * cosine))
        return y, C @ (omega * sine) - S @ (omega * cosine), bend

    def _fitted(self, x: Array, y: Array, rate: Array, factor: float) -> tuple[Array, Array]:
        """Factor and centre (r,) of the swing."""
        reach, speed = np.ptp(y, axis=0), np.abs(rate).max(axis=0)
        room = self.limits.upper - self.limits.lower
        use, place = (_logistic(part) for part in x[-2 * self.dof :].reshape(2, -1))
        used = factor * use * np.minimum(room / reach, self.limits.velocity / speed)
        return used, self.limits.lower - used * y.min(axis=0) + place * (room - used * reach)

    def _along(self, x: Array, factor: float) -> Array:
        p, v, a = self.motion(x, factor)
        return self._regressor(p, v, v, a)

    def _share(self, Y: Array) -> float:
        return float((np.abs(Y @ self.model.fundamental_parameters) / self.limits.torque).max())

    @cached_property
    def _known(self) -> Array:
        """Scaled Y'Y (k, k) in s of the earlier motion."""
        if self.earlier is None:
            return np.zeros((len(self.scale), len(self.scale)))
        p, v, a = self.earlier
        return _gram(self._regressor(p, v, v, a) * self.scale) / INDEPENDENT_ROW_RATE

    @cached_property
    def _order(self) -> Array:
        return np.arange(1.0, self.harmonics + 1.0)[:, None]

    @cached_property
    def _waves(self) -> tuple[Array, Array]:
        turns = np.arange(SAMPLES_PER_PERIOD * self.harmonics)[:, None] / (SAMPLES_PER_PERIOD * self.harmonics)
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
    earlier: Motion | None = None,
    iterations: int = 100,
    seed: int = 0,
    progress: Callable[[float], object] | None = None,
) -> ExcitationTrajectory:
    """
    Optimise a periodic reference for the identification of a model's parameters.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    frequency : float, default 0.1
        Fundamental frequency in Hz. 0.1 Hz is a period of 10 s, whose five harmonics reach 0.5 Hz.
    harmonics : int, default 5
        Sines and cosines in the series of each joint, at least 1. Five give each joint ten coefficients; more take
        longer to optimise.
    limit_share : float, default 0.8
        Fraction of the joints' own limits, unless `limits` are given. The default keeps a fifth for the tracking error.
    scale : array_like, optional
        Prior ranges (k,) in SI units, or one number, those of `PriorRanges` unless given.
    limits : MotionLimits, optional
        Limits of the reference. Torques are the model's own: give lower limits for uncertain parameters.
    earlier : tuple of ndarray, optional
        Positions, velocities and accelerations (n, r) of an earlier motion, 50 a second. The condition is then that of
        both together, so that the search is for what the earlier one left open.
    iterations : int, default 100
        Iterations of the search, at most; fewer if it converges before.
    seed : int, default 0
        Seed of the ten random references from which the search starts. Fixed, so that a result can be repeated.
    progress : callable, optional
        Function that is called with the fraction done after each iteration.

    Returns
    -------
    ExcitationTrajectory
        Reference with the least condition number found. Ctrl-C ends the search with the best so far.

    Raises
    ------
    InputError
        If a number is out of range, a shape is wrong, or torques exceed their limits even at rest.

    Notes
    -----
    Fourier series within limits [1]_, by L-BFGS.

    References
    ----------
    .. [1] Swevers et al., IEEE Trans. Robotics and Automation, 1997.

    Examples
    --------
    >>> adaptctl.control.excitation_trajectory(model, harmonics=2, iterations=1).torque_share <= 1.0
    True
    """
    iterations = whole_count(iterations, "iterations", 1)
    search = replace(_checked(model, frequency, harmonics, limit_share, scale, limits), earlier=earlier)
    rng = np.random.default_rng(whole_count(seed, "seed"))
    starts = [search.random(rng) for _ in range(RANDOM_REFERENCES)]
    random_conditions = np.array([search.within(x)[1] for x in starts])
    best = _Best(search, starts[int(np.argmin([search.cost(x) for x in starts]))], iterations, progress)
    complete = True
    try:
        options = {"maxiter": iterations, "maxfun": 100 * iterations * search.size}
        from scipy.optimize import minimize  # takes long to load

        minimize(best.cost, best.x, method="L-BFGS-B", callback=best.iterated, options=options)  # type: ignore[call-overload]  # in no stub
    except KeyboardInterrupt:
        complete = False
    reference, condition, torque_share = search.within(best.x)
    return ExcitationTrajectory(reference, condition, random_conditions, torque_share, best.iterations, complete)


class _Best:
    def __init__(self, search: FourierSearch, x: Array, most: int, progress: Callable[[float], object] | None) -> None:
        self.search, self.x, self.lowest = search, x, search.cost(x)
        self.iterations, self._most, self._progress = 0, most, progress

    def cost(self, x: Array) -> float:
        value = self.search.cost(x)
        if value < self.lowest:
            self.x, self.lowest = x.copy(), value
        return value

    def iterated(self, x: Array) -> None:
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
    validate_kind(model, ReducedModel, "excitation trajectory", "as ReducedModel(mechanism) is one")
    frequency = positive_number(frequency, "frequency: expected a positive one in Hz")
    harmonics = whole_count(harmonics, "harmonics", 1)
    validate_share(share)
    if limits is not None:
        validate_limits(limits, model.mechanism.dof)
    k = len(model.columns)
    ranges = PriorRanges().for_parameters(model.names) if scale is None else numbers(scale, "scale")
    ranges = frozen_array(np.broadcast_to(ranges, (k,)) if ranges.ndim == 0 else ranges, (k,), "scale")
    if not np.all(ranges > 0.0):
        raise InputError(f"scale: expected positive numbers, got {ranges.tolist()}")
    return FourierSearch(model, limits or MotionLimits.from_model(model, share), frequency, harmonics, ranges)


def _gram(Y: Array) -> Array:
    """Y'Y (k, k), in products too small for threads."""
    samples, rows, k = Y.shape
    together = max(1, MAX_UNTHREADED_PRODUCT // (rows * k * k))
    whole = samples // together * together
    parts = Y[:whole].reshape(-1, together * rows, k)
    rest = Y[whole:].reshape(-1, k)
    return np.asarray(np.sum(np.swapaxes(parts, 1, 2) @ parts, axis=0) + rest.T @ rest)


def _logistic(x: Array) -> Array:
    """1/(1 + exp(-x)) of any x."""
    return 1.0 / (1.0 + np.exp(-np.clip(x, -MAX_LOGIT, MAX_LOGIT)))
