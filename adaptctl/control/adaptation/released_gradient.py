"""Gradient adaptation with a normaliser that is released slowly: a discrete-time theorem for every gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.control.gains.hold import hold_number, slowest_decay
from adaptctl.control.gains.workspace import Workspace
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, maximum


class Normaliser(NamedTuple):
    """The memory of a normalised gradient: its normaliser n."""

    n: Any
    """(1,) at least 1"""


@dataclass(frozen=True, eq=False)
class ReleasedGradient(Descent[Normaliser]):
    """Normalised gradient adaptation whose normaliser n is released in time.

        estimate -= (T_c/n) Gamma Y_k' s_k+1,  n_k = max(1, share T_c tr(K^-1 Y Gamma Y'), n_k-1/(1 + release T_c))

    `release` is in 1/s, `share` without a unit. s (r,) is the sliding variable in rad/s (m/s), Y (r, k) the torque
    regressor, Y_k its value at tick k, K the damping, T_c the period; `gain` is Gamma, (k,) its diagonal or (k, k), in
    units of the parameters squared per J. Arguments that the theorem allows come from `ReleasedGradient.certified`.
    Raises `InputError` for a gain that is not positive definite and a release or share that is not positive.

    Guarantees, sampled, with M constant over the ticks considered, for any Gamma and any Y from tick to tick:
    V = s'Ms/(2n) + error' Gamma^-1 error/2 never rises where share > 1/(2 - h), h = T_c lambda_max(M^-1 K) < 2, and
    release <= 2 (1 - h/2 - 1/(2 share)) lambda_min(M^-1 K). As T_c goes to zero n goes to 1, and this to `Gradient`.
    The derivation: docs/discrete_adaptation.md.

    Gives up: a constant M, as every such theorem here does; speed, while n is large; and the operations of r gradients,
    for the trace. The rest as `Gradient`.
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
        cls, model: ReducedModel, gain: ArrayLike, damping: ArrayLike, period: float, workspace: Workspace | None = None
    ) -> ReleasedGradient:
        """The law with share and release by the theorem, for a damping K in N m s/rad (N s/m), one number or (r,), a
        period T_c (s) and a workspace, all that the joints' limits allow where None.

        `gain` is Gamma, (k,) or (k, k), in units of the parameters squared per J. Raises `GainError` where the period
        does not carry the damping, and `InputError` for a gain that is not positive definite and a damping or period
        that is not positive.
        """
        h = hold_number(model.mechanism, damping, period, workspace=workspace).value
        if not h < 2.0:
            raise GainError(f"released gradient: the hold number is {h:.3g}, and there is a theorem below 2 only")
        slowest = slowest_decay(model.mechanism, damping, workspace)
        return cls(np.asarray(gain), 0.5 * (2.0 - h) * slowest, 2.0 / (2.0 - h))

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Normaliser:
        """The memory before the first tick: a normaliser n of 1.

        `initial` is the first estimate (k,), q (n,) the configuration of the tree's joints in rad (m), v (r,) the
        velocities in rad/s (m/s), `period` T_c in s.
        """
        return Normaliser(np.ones(1))

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: Normaliser
    ) -> tuple[Column, Normaliser]:
        """The estimate (k,) after a step down the gradient by the backward rule, and the memory of the normaliser.

        `estimate` (k,), in the parameters' SI units, and `memory` are those before the control period `period`.
        """
        released = memory.n[0] / (1.0 + self.release * period.elapsed)
        n = maximum(maximum(released, 1.0), (self.share * period.elapsed) * self._trace(period))
        moved = estimate - (period.elapsed / n) * self.applied(period.gradient(period.after))
        return moved, Normaliser(Column((n,)))

    def _trace(self, period: Period) -> Scalar:
        """tr(K^-1 Y Gamma Y')."""
        r, total = len(period.after), 0.0
        for i in range(r):
            row = period.gradient(Column(float(i == j) for j in range(r)))
            total = total + row @ self.applied(row) / period.damping[i]
        return total
