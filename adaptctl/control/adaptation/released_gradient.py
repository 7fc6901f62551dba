"""Normalised gradient adaptation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number
from adaptctl.control.adaptation.gradient import Descent, checked_gain, validate_size
from adaptctl.control.adaptation.law import Period
from adaptctl.control.gains.sampling_ratio import sampling_ratio, slowest_decay
from adaptctl.control.gains.workspace import Workspace
from adaptctl.errors import GainError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, maximum


class Normaliser(NamedTuple):
    """Divisor (1,) of steps, at least 1."""

    n: Any


@dataclass(frozen=True, eq=False)
class ReleasedGradient(Descent[Normaliser]):
    r"""
    Gradient adaptation with a normaliser, stable in discrete time.

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    release : float, default 1.0
        Rate in 1/s at which the normaliser n decays after large regressors. At 1 the time constant is 1 s.
    share : float, default 4.0
        Factor of the trace in the normaliser n, without a unit. 4 is what `certified` gives at a sampling ratio of 1.5,
        the largest accepted.

    Raises
    ------
    InputError
        If the gain is not positive definite, or release or share not positive.

    Notes
    -----
    .. math::

        \hat\beta_{j+1}=\hat\beta_j-(T_c/n_j)\Gamma Y_j^\top s_{j+1},\quad
        n_j=\max(1,\text{share}\,T_c\operatorname{tr}(K^{-1}Y_j\Gamma Y_j^\top),n_{j-1}/(1+\text{release}\,T_c)).

    With settings of `certified`, not the defaults, the Lyapunov function never rises at a constant mass matrix; see
    docs/discrete_adaptation.md.

    Examples
    --------
    >>> released = adaptctl.control.ReleasedGradient.certified(model, np.full(6, 5.0), [6.0, 2.0], period)
    >>> adaptctl.SlotineLi(model, 5.0, [6.0, 2.0], released).dof
    2
    """

    release: float = 1.0
    share: float = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("release", "share"):
            positive_number(getattr(self, name), f"released gradient: {name}: expected a positive finite number")

    @classmethod
    def certified(
        cls,
        model: ReducedModel,
        gain: ArrayLike,
        damping: ArrayLike,
        control_period: float,
        workspace: Workspace | None = None,
    ) -> ReleasedGradient:
        """
        Return the law with settings for which the Lyapunov function never rises in discrete time.

        Parameters
        ----------
        model : ReducedModel
            Reduced model of the mechanism with k parameters and r primary joints.
        gain : array_like
            Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per
            J.
        damping : array_like
            Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
        control_period : float
            Time in s for which a torque is held.
        workspace : Workspace, optional
            Joint positions that are searched. Unless given, all that the joints' limits allow.

        Returns
        -------
        ReleasedGradient
            Law with a share of 2/(2 - h), h the sampling ratio, and a release of (1 - h/2) times the slowest decay.

        Raises
        ------
        GainError
            If the sampling ratio is 2 or more.
        InputError
            If gain, damping or period is not positive, or a shape is wrong.

        Examples
        --------
        >>> gain = np.full(len(model.names), 0.1)
        >>> law = adaptctl.control.ReleasedGradient.certified(model, gain, [6.0, 2.0], period)
        >>> law.share > 1.0
        True
        """
        gamma = checked_gain(gain)
        validate_size(gamma, model, "adaptation gain")
        h = sampling_ratio(model.mechanism, damping, control_period, workspace=workspace).value
        if not h < 2.0:
            raise GainError(f"released gradient: the sampling ratio is {h:.3g}, but the theorem needs a ratio below 2")
        slowest = slowest_decay(model.mechanism, damping, workspace)
        return cls(gamma, 0.5 * (2.0 - h) * slowest, 2.0 / (2.0 - h))

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> Normaliser:
        """
        Return the initial state, a normaliser of 1.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        initial : ndarray
            Initial estimate (k,) in SI units.
        q, v : ndarray
            Positions (..., n) in rad (m) of the n joints of the spanning tree, and velocities (..., r) of the primary
            joints in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        Normaliser
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.
        """
        return Normaliser(np.ones(1))

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: Normaliser
    ) -> tuple[Column, Normaliser]:
        """
        Update the estimate by a gradient step divided by the normaliser.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : Normaliser
            Internal state before the period.

        Returns
        -------
        tuple of Column and Normaliser
            Estimate (k,) in SI units and internal state after the period.
        """
        released = memory.n[0] / (1.0 + self.release * period.dt)
        n = maximum(maximum(released, 1.0), (self.share * period.dt) * self._trace(period))
        moved = estimate - (period.dt / n) * self.applied(period.gradient(period.s))
        return moved, Normaliser(Column((n,)))

    def _trace(self, period: Period) -> Scalar:
        r, total = len(period.s), 0.0
        for i in range(r):
            row = period.gradient(Column(float(i == j) for j in range(r)))
            total = total + row @ self.applied(row) / period.damping[i]
        return total
