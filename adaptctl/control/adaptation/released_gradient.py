"""Gradient adaptation with a normaliser that is released slowly: a discrete-time theorem for every gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gradient import Descent, checked_gain, validate_size
from adaptctl.control.adaptation.law import Period
from adaptctl.control.gains.sampling_ratio import sampling_ratio, slowest_decay
from adaptctl.control.gains.workspace import Workspace
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, maximum


class Normaliser(NamedTuple):
    """Internal state of normalised gradient adaptation between control periods: `n` (1,), the normaliser, at least 1
    and without a unit, by which steps of the estimate are divided. Nothing is checked."""

    n: Any


@dataclass(frozen=True, eq=False)
class ReleasedGradient(Descent[Normaliser]):
    """Normalised gradient adaptation of the estimate (k,) of k parameters, whose step is divided by a normaliser n,
    without a unit, that decays in time.

        estimate -= (T_c/n_j) Gamma Y_j' s_(j+1)
        n_j = max(1, share T_c tr(K^-1 Y_j Gamma Y_j'), n_(j-1)/(1 + release T_c))

    j counts the control periods; `release`, 1 by default, is in 1/s, `share`, 4 by default, without a unit. s (r,) is
    the sliding variable of r joints in rad/s (m/s for a prismatic joint), Y (r, k) the torque regressor, K (r,) the
    control law's damping in N m s/rad (N s/m), T_c the control period in s; `gain` is Gamma, (k,) its diagonal or (k,
    k), in units of the parameters squared per J. The theorem below does not cover every `release` and `share`, nor the
    defaults: `ReleasedGradient.certified` makes those that it covers. A prime is the transpose. Raises `InputError` for
    a gain that is not finite, symmetric and positive definite and a release or share that is not positive and finite.

    Guarantees, sampled, with the mass matrix M constant, for any Gamma and any Y that varies from one control period to
    the next: V = s'Ms/(2n) + error' Gamma^-1 error/2, error the estimate less the truth, never rises where share > 1/(2
    - h), h = T_c lambda_max(M^-1 K) < 2, and release <= 2 (1 - h/2 - 1/(2 share)) lambda_min(M^-1 K), with the largest
    and the least eigenvalue lambda_max and lambda_min. As T_c goes to zero n goes to 1, and this law to `Gradient`. The
    derivation: docs/discrete_adaptation.md.

    Gives up: an M that changes, as every such theorem here does; speed, while n is large; and the operations of r
    gradients, for the trace. Under disturbance and without excitation the estimate drifts, it need not become the true
    one, and nothing keeps it physically consistent.
    """

    release: float = 1.0
    share: float = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("release", "share"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InputError(
                    f"released gradient: {name}: expected a positive finite number, got {getattr(self, name)}"
                )

    @classmethod
    def certified(
        cls,
        model: ReducedModel,
        gain: ArrayLike,
        damping: ArrayLike,
        control_period: float,
        workspace: Workspace | None = None,
    ) -> ReleasedGradient:
        """Normalised gradient adaptation law, a `ReleasedGradient`, whose Lyapunov function never rises under a control
        law's `damping` K and a control `period` T_c (s). Its field `share` is 2/(2 - h), without a unit, and its field
        `release` (1 - h/2) lambda_min(M^-1 K) in 1/s.

        h = T_c lambda_max(M^-1 K) is the sampling ratio, without a unit, lambda_min and lambda_max the least and the
        largest eigenvalue and M the mass matrix of the `model`, taken as constant from one control period to the next.
        Both extremes are sought by a local search over the set of joint positions `workspace`, all that the joints'
        limits allow where None. K is in N m s/rad (N s/m if prismatic), one number or (r,) for r joints. `gain` is
        Gamma, (k,) its diagonal or (k, k) for k parameters, in units of the parameters squared per J. Raises
        `GainError` where h is 2 or more, and `InputError` for a gain that is not finite, symmetric and positive
        definite or of another size, a damping that is not positive and finite or of another size and a period that is
        not positive and finite.
        """
        gamma = checked_gain(gain)
        validate_size(gamma, model, "adaptation gain")
        h = sampling_ratio(model.mechanism, damping, control_period, workspace=workspace).value
        if not h < 2.0:
            raise GainError(f"released gradient: the sampling ratio is {h:.3g}, and there is a theorem below 2 only")
        slowest = slowest_decay(model.mechanism, damping, workspace)
        return cls(gamma, 0.5 * (2.0 - h) * slowest, 2.0 / (2.0 - h))

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> Normaliser:
        """The internal state before the first control period: the normaliser (1,), without a unit, by which steps of
        the estimate are divided, which is 1. All arguments are ignored: the `model`, the initial estimate `initial`
        (k,) of its k parameters, positions q (..., n) of the spanning tree's n joints in rad (m for a prismatic joint),
        velocities v (..., r) of the r primary (independent) joints in rad/s (m/s), leading axes for arms, and the
        control `period` in s."""
        return Normaliser(np.ones(1))

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: Normaliser
    ) -> tuple[Column, Normaliser]:
        """The estimate (k,) of the `model`'s k parameters after the step -(T_c/n) Gamma Y' s, T_c being the control
        period in s, and the internal state, the normaliser n (1,) of at least 1, without a unit. Gamma is the
        adaptation gain, Y' the transpose of the torque regressor Y (r, k) at the period's start, s (r,) the sliding
        variable of r joints, rad/s (m/s if prismatic), at its end.

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        released = memory.n[0] / (1.0 + self.release * period.dt)
        n = maximum(maximum(released, 1.0), (self.share * period.dt) * self._trace(period))
        moved = estimate - (period.dt / n) * self.applied(period.gradient(period.s))
        return moved, Normaliser(Column((n,)))

    def _trace(self, period: Period) -> Scalar:
        """tr(K^-1 Y Gamma Y')."""
        r, total = len(period.s), 0.0
        for i in range(r):
            row = period.gradient(Column(float(i == j) for j in range(r)))
            total = total + row @ self.applied(row) / period.damping[i]
        return total
