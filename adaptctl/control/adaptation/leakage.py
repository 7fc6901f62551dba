"""Adaptation that leaks back to a prior, so that it cannot drift: sigma- and e-modification."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column, sqrt


@dataclass(frozen=True, eq=False)
class _Leaking(Descent[NoMemory]):
    """Gradient descent that leaks, at a `rate`, to a `prior` (k,), zero when not given."""

    rate: float = 0.1
    prior: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise InputError(f"leakage rate: expected a positive number, got {self.rate}")
        prior = np.zeros(len(self.gain)) if self.prior is None else self.prior
        object.__setattr__(self, "prior", frozen_array(prior, (len(self.gain),), "leakage: prior"))

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """The empty memory: this law remembers nothing."""
        return NoMemory()

    def leaked(self, estimate: Column, period: Period, rate: Any) -> Column:
        """The estimate after a step down the gradient by the trapezium, and of the leak by the implicit rule, so that
        no rate (1/s) is too large for the period."""
        share = period.elapsed * rate
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

    tunable = ("gain", "rate", "prior")

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
        return self.leaked(estimate, period, self.rate), memory


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

    tunable = ("gain", "rate", "prior")

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
        return self.leaked(estimate, period, self.rate * sqrt(s @ s)), memory
