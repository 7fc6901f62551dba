"""Gradient adaptation: the law of Slotine and Li's theorem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, per_joint, positive_numbers, positive_per_joint
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.gains.sampling_ratio import scaled_eigenvalues
from adaptctl.control.pytree import Memory
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, each, sqrt, where


@dataclass(frozen=True, eq=False)
class Descent(AdaptationLaw[Memory]):
    """Base class of adaptation laws for k parameters by descent along a gradient (k,) with a constant adaptation gain
    Gamma. `gain` is Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J, and
    is kept as a read-only array.

    A subclass writes the methods `start(model, initial, q, v, period)`, which returns the internal state before the
    first control period, and `law(model, estimate, period, memory)`, which returns the estimate (k,) and the internal
    state after one; the method `applied` multiplies by Gamma for it. Raises `InputError` at construction for a gain
    that is not finite, positive and, as a matrix, symmetric and positive definite.
    """

    gain: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_gain(self.gain))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` where the adaptation gain is for another number of parameters than the `model`'s k.
        `initial`, the initial estimate (k,), and `period`, the control period in s, are not used."""
        validate_size(self.gain, model, "adaptation gain")

    @property
    def by_parameter(self) -> bool:
        """True if the adaptation gain is diagonal, so that the law's Lyapunov function is a sum over the single
        parameters' errors, and clipping one parameter to a bound need not move any other."""
        return self.gain.ndim == 1

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """The parameters' term error' Gamma^-1 error / 2, in J, of the adaptation law's Lyapunov function. Gamma is the
        adaptation gain, a prime the transpose and error the `estimate` (k,) of the model's k parameters less their
        `true` values (k,), both in SI units, scalars of any kind: floats, arrays of samples, nodes of an expression
        graph. Raises `ValueError` for columns of different lengths."""
        error, gain = estimate - true, self._columns
        if isinstance(gain, list):
            return 0.5 * (error @ solve_symmetric([list(row) for row in gain], error))
        return 0.5 * (error @ Column(e / g for e, g in zip(error, gain, strict=True)))

    def applied(self, gradient: Column) -> Column:
        """The product Gamma x (k,) of the adaptation gain Gamma of k parameters and a `gradient` x (k,), in the unit of
        each parameter where x is in J per unit of it. Raises `ValueError` for a gradient of another length."""
        gain = self._columns
        return Column(row @ gradient for row in gain) if isinstance(gain, list) else gain * gradient

    @property
    def _columns(self) -> Column | list[Column]:
        """Gamma over scalars: its diagonal, or its rows."""
        rows: Any = self.gain
        if getattr(rows, "ndim", 1 + isinstance(rows, tuple)) == 2:  # an array, or a tuple of columns
            return [column(row) for row in rows]
        return column(rows)


def checked_gain(gain: ArrayLike) -> Array:
    """A read-only float64 copy of an adaptation `gain` of k parameters, its diagonal (k,) or whole (k, k), in units of
    the parameters squared per J. Raises `InputError` for another shape, for entries that are no finite numbers, for no
    entries at all, for a diagonal that is not positive, and for a matrix that is not symmetric (to 1e-12 of its largest
    entry) and positive definite (all eigenvalues above 0 once its diagonal is scaled to 1)."""
    array = numbers(gain, "adaptation gain")
    k = array.shape[:1]
    array = frozen_array(array, (*k, *k) if array.ndim == 2 else k, "adaptation gain")
    if array.ndim not in (1, 2) or not array.size:
        raise InputError(f"adaptation gain: expected numbers (k,), one a parameter, or (k, k), got shape {array.shape}")
    positive = np.all(array > 0.0) if array.ndim == 1 else _is_positive_definite(array)
    if not positive:
        raise InputError("adaptation gain: expected a positive diagonal or a symmetric positive definite matrix")
    return array


def validate_size(values: Array, model: ReducedModel, what: str) -> None:
    """Raise `InputError` unless `values`, an array (k, ...), has one row for each of the `model`'s k parameters. `what`
    names it in the message."""
    k, given = len(model.columns), len(values)
    if given == k:
        return
    hint = ""
    if given == len(model.mechanism.parameter_names):
        hint = f"; these are for all {given} parameters, of which the basis keeps {k}: take model.columns of them"
    raise InputError(f"{what}: expected {k} numbers, one a parameter of the model, got {given}{hint}")


def _is_positive_definite(matrix: Array) -> bool:
    """True if a matrix is symmetric and positive definite, to round-off of its largest entry; its parameters' units are
    scaled out first."""
    symmetric = np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12 * np.abs(matrix).max(initial=0.0))
    return bool(symmetric and np.all(np.diagonal(matrix) > 0.0) and scaled_eigenvalues(matrix)[0] > 0.0)


TINY = 1e-300
"""Added to a power, so that nothing is divided by zero where s is zero."""


@dataclass(frozen=True, eq=False)
class Gradient(Descent[NoMemory]):
    """Gradient adaptation of the estimate (k,) of k parameters, estimate' = -Gamma Y' s (Slotine and Li 1987), once a
    control period.

        estimate -= T_c n Gamma x,  x = Y_j' s,  s = s_j + theta (s_(j+1) - s_j) from tick j to j + 1
        n = s'Ks/(s'Ks + cap T_c x'Gamma x)

    j counts the control periods. `theta`, without a unit, is 1 for the backward rule, which is the default, 1/2 for the
    trapezium and 0 for Euler's. With the factor n, of `cap` without a unit, 2 by default, the step's power T_c n
    x'Gamma x is at most s'Ks/cap, s'Ks being what the damping takes out; a cap of 0 leaves n out. s (r,) is the sliding
    variable of r joints in rad/s (m/s for a prismatic joint), Y (r, k) the torque regressor, K (r,) the control law's
    damping in N m s/rad (N s/m), T_c the period in s; `gain` is Gamma, (k,) its diagonal or (k, k), in units of the
    parameters squared per J. A prime is the transpose, but on estimate a derivative in time. Raises `InputError` for a
    gain that is not finite, symmetric and positive definite, a theta outside [0, 1] and a cap that is negative or not
    finite.

    Guarantees, in continuous time and without disturbance: V = s'Ms/2 + error' Gamma^-1 error/2, M the mass matrix and
    error the estimate less the truth, has the time derivative -s'Ks, so the tracking error goes to zero and the
    estimate stays bounded. Sampled, with M constant and without the factor n, let h = T_c lambda_max(M^-1 K), the hold
    number, and a = T_c lambda_max(K^-1 Y Gamma Y'), both without a unit, lambda_max being the largest eigenvalue. By
    the backward rule V falls where a + h < 2; by the trapezium s'(M - T_c K/2)s/2 + error' Gamma^-1 error/2 falls where
    a < 2 and h < 2; Euler's rule has no such function and serves for comparison. With n there is no theorem, only
    experience: it is there for a beyond these bounds. `ReleasedGradient` has one for every a. The derivations:
    docs/discrete_adaptation.md.

    Gives up: with any disturbance (friction, noise, saturation) and no persistent excitation the estimate drifts
    without bound; it need not become the true one; and nothing keeps it physically consistent.
    """

    tunable = ("gain",)

    theta: float = 1.0
    cap: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.theta <= 1.0:
            raise InputError(f"gradient: theta: expected a number from 0 (Euler) to 1 (backward), got {self.theta}")
        if not (np.isfinite(self.cap) and self.cap >= 0.0):
            raise InputError(f"gradient: cap: expected a finite number of at least 0, got {self.cap}")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after the step -T_c n Gamma Y' s, T_c being the control
        period in s, and the empty internal state. Gamma is the adaptation gain, Y' the transpose of the torque
        regressor Y (r, k) at the period's start.

        s (r,) is the sliding variable of r joints, rad/s (m/s if prismatic): s_0 + theta (s_1 - s_0), s_0 and s_1 those
        at the period's start and end, so that it is s_1 for the default, 1, of the law's attribute `theta`. n is 1
        where the law's attribute `cap` is 0; else it is a factor of at most 1, s'Ks/(s'Ks + cap T_c x'Gamma x) with x =
        Y' s and the control law's damping K, which limits the power of the step.

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        s = period.s if self.theta == 1.0 else period.s_prev + self.theta * (period.s - period.s_prev)
        slope = period.gradient(s)
        step = self.applied(slope)
        return estimate - (period.dt * self._share(period, s, slope @ step)) * step, memory

    def _share(self, period: Period, s: Column, square: Any) -> Any:
        """n, for x'Gamma x."""
        if self.cap == 0.0:
            return 1.0
        power = s @ (period.damping * s)
        return power / (power + (self.cap * period.period) * square + TINY)


@dataclass(frozen=True, eq=False)
class DeadZone(Descent[NoMemory]):
    """Gradient adaptation of the estimate (k,) of k parameters with a dead zone for the sliding variable s (Peterson
    and Narendra 1982).

        estimate' = -Gamma Y' s outside the ellipsoid sum (s_i / width_i)^2 <= 1, and 0 within

    s (r,), of r joints, is in rad/s (m/s for a prismatic joint), Y (r, k) is the torque regressor; `gain` is Gamma,
    (k,) its diagonal or (k, k), in units of the parameters squared per J. `width` is the zone's half-width in rad/s
    (m/s), one number for all joints, 0.05 by default, or (r,). A prime is the transpose, but on estimate and V a
    derivative in time. Raises `InputError` for a gain that is not finite, symmetric and positive definite and a width
    that is not positive and finite, and, with a controller, for a gain or width that does not fit its model's k
    parameters or r joints.

    Guarantees: within the zone the estimate stands still, so nothing that keeps s there makes it drift. Outside, V =
    s'Ms/2 + error' Gamma^-1 error/2 has V' = -s'Ks + s'd, error the estimate less the truth, M the mass matrix, K the
    control law's damping, d (r,) the disturbance torque: not positive where the zone holds {s: s'Ks <= d'K^-1d}.
    `DeadZone.against` makes that zone.

    Gives up: tracking better than the zone; and a bound on the estimate where s enters and leaves the zone infinitely
    often: as M varies with the positions, s may leave with a larger s'Ms/2 than it came in with. `Projection` of this
    law has that bound.
    """

    tunable = ("gain", "width")

    width: Array = 0.05  # type: ignore[assignment]  # a number becomes an array for the model's joints

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_numbers(self.width, "dead zone: width")

    @classmethod
    def against(cls, gain: ArrayLike, damping: ArrayLike, torque: ArrayLike) -> DeadZone:
        """Dead-zone adaptation law, a `DeadZone`, for disturbance torques d of at most `torque` under a control law of
        `damping` K: the zone is {s: s'Ks <= d'K^-1 d} for sliding variables s (r,). A prime is the transpose.

        `torque`, in N m (N for a prismatic joint), and `damping`, in N m s/rad (N s/m), are one number for all joints
        or (r,), one a joint. The number r of joints is taken from them: where both are one number, the zone is that of
        an arm of one joint, which models of other arms refuse. `gain` is the adaptation gain Gamma of k parameters,
        (k,) its diagonal or (k, k), in units of the parameters squared per J. Raises `InputError` for a damping that is
        not positive, torques and dampings of different sizes, a gain that is not symmetric and positive definite, and
        torques that are negative, all zero or not finite.
        """
        joints = max(np.size(torque), np.size(damping))
        d, K = per_joint(torque, joints, "dead zone: torque"), positive_per_joint(damping, joints, "damping")
        if np.any(d < 0.0):
            raise InputError(f"dead zone: torque: expected numbers of at least 0, got {d.tolist()}")
        return cls(np.asarray(gain), np.sqrt((d**2 / K).sum() / K))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation gain is for the `model`'s k parameters, and the half-width of the
        dead zone is one positive number or one for each of its r joints. `initial`, the initial estimate (k,), and
        `period`, the control period in s, are not used."""
        super().validate(model, initial, control_period)
        positive_per_joint(self.width, model.mechanism.dof, "dead zone: width")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after a control period, and the empty internal state. Within
        the dead zone the estimate is unchanged; outside, it has taken the step -Gamma Y' times the integral of s over
        the period (trapezium rule).

        Gamma is the adaptation gain, Y' the transpose of the torque regressor Y (r, k) at the period's start, s (r,)
        the sliding variable of r joints, rad/s (m/s if prismatic). The zone is one ellipsoid for all joints together:
        sum (m_i/width_i)^2 <= 1, m (r,) the mean of s at the period's start and end, and the law's attribute `width`
        the zone's half-widths, rad/s (m/s).

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        scaled = Column(1.0 / width for width in each(self.width, model.mechanism.dof)) * period.mean
        outside = where(scaled @ scaled > 1.0, 1.0, 0.0)
        return estimate - self.applied(period.gradient(outside * period.integral)), memory


@dataclass(frozen=True, eq=False)
class _Leaking(Descent[NoMemory]):
    """Gradient descent that leaks, at a `rate`, to a `prior` (k,), zero when not given."""

    leakage: float = 0.1
    prior: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.leakage) and self.leakage > 0.0):
            raise InputError(f"leakage rate: expected a positive number, got {self.leakage}")
        prior = np.zeros(len(self.gain)) if self.prior is None else self.prior
        object.__setattr__(self, "prior", frozen_array(prior, (len(self.gain),), "leakage: prior"))

    def leaked(self, estimate: Column, period: Period, rate: Any) -> Column:
        """The estimate after a step down the gradient by the trapezium, and of the leak by the implicit rule, so that
        no rate (1/s) is too large for the period."""
        share = period.dt * rate
        moved = estimate - self.applied(period.gradient(period.integral))
        return (1.0 / (1.0 + share)) * (moved + share * column(self.prior))


@dataclass(frozen=True, eq=False)
class SigmaModification(_Leaking):
    """Gradient adaptation of the estimate (k,) of k parameters with sigma-modification, a constant leak back to the
    prior (Ioannou and Kokotovic 1984).

        estimate' = -Gamma Y' s - sigma (estimate - prior),  `rate` is sigma, in 1/s, 0.1 by default

    s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic joint), Y (r, k) the torque regressor;
    `gain` is Gamma, (k,) its diagonal or (k, k), in units of the parameters squared per J; `prior` (k,) is in the
    parameters' SI units, zero when None. A prime is the transpose, but on estimate and V a derivative in time. Raises
    `InputError` for a gain that is not finite, symmetric and positive definite, a rate that is not positive and finite,
    and a prior of another size or not finite. The leak is Gamma times sigma Gamma^-1 (estimate - prior), so that
    parameters of different units leak alike.

    Guarantees: under any bounded disturbance s and the estimate stay bounded, without excitation: with the mass matrix
    M, the control law's damping K, V = s'Ms/2 + (estimate - true)' Gamma^-1 (estimate - true)/2 and c = min(sigma, 2
    lambda_min(M^-1 K)), lambda_min the least eigenvalue and true the true parameters, V' <= -c V + sigma V_prior,
    V_prior = (prior - true)' Gamma^-1 (prior - true)/2; with a disturbance torque d (r,), c is half as large and
    d'K^-1d/2 is added.

    Gives up: convergence of the tracking error, even without disturbance, unless the prior is true: the leak goes on
    when s is zero, and bursts may follow (Hsu and Costa 1987).
    """

    tunable = ("gain", "leakage", "prior")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after a control period, and the empty internal state. The
        estimate first takes the step -Gamma Y' times the integral of s over the period (trapezium rule), then leaks to
        the prior estimate by the implicit Euler rule: with x = T_c sigma, it becomes (moved + x prior)/(1 + x), T_c (s)
        being the control period, sigma (1/s) the law's attribute `rate` and moved (k,) the estimate after that step.

        Gamma, (k,) its diagonal or (k, k), is the adaptation gain in the parameters' units squared per J, Y' the
        transpose of the torque regressor Y (r, k) at the period's start, s (r,) the sliding variable of r joints, rad/s
        (m/s if prismatic). `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those
        before the control period that `period` describes. Nothing is checked here.
        """
        return self.leaked(estimate, period, self.leakage), memory


@dataclass(frozen=True, eq=False)
class EModification(_Leaking):
    """Gradient adaptation of the estimate (k,) of k parameters with e-modification, a leak to the prior that stops with
    the sliding variable s (Narendra and Annaswamy 1987).

        estimate' = -Gamma Y' s - nu |s| (estimate - prior),  `rate` is nu, in 1/rad (1/m), 0.1 by default

    s (r,), of r joints, is in rad/s (m/s for a prismatic joint), |s| its Euclidean norm, Y (r, k) the torque regressor;
    `gain` is Gamma, (k,) its diagonal or (k, k), in units of the parameters squared per J; `prior` (k,) is in the
    parameters' SI units, zero when None. A prime is the transpose, but on estimate a derivative in time. Raises
    `InputError` for a gain that is not finite, symmetric and positive definite, a rate that is not positive and finite,
    and a prior of another size or not finite.

    Guarantees: under any bounded disturbance s and the estimate stay bounded, without excitation. The leak stops with
    s, so true estimates on the trajectory stay where they are.

    Gives up: where disturbances keep s from zero the estimate is still pulled to the prior; the leak is slow where s is
    small, so the bound is looser than sigma-modification's.
    """

    tunable = ("gain", "leakage", "prior")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after a control period, and the empty internal state. The
        estimate has taken the step -Gamma Y' times the integral of s over the period (trapezium rule), and a leak to
        the prior estimate at the rate nu |m| (1/s) by the implicit rule, nu being the law's attribute `rate` (1/rad,
        1/m if prismatic).

        Gamma is the adaptation gain, Y' the transpose of the torque regressor Y (r, k) at the period's start, s (r,)
        the sliding variable of r joints, rad/s (m/s if prismatic), |m| the Euclidean norm of the mean m (r,) of s at
        the period's start and end. `estimate` (k,), in the parameters' SI units, and the internal state `memory` are
        those before the control period that `period` describes. Nothing is checked here.
        """
        s = period.mean
        return self.leaked(estimate, period, self.leakage * sqrt(s @ s)), memory
