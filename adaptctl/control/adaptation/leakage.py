"""Gradient adaptation with leakage."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array, frozen_array, positive_number
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column, sqrt


@dataclass(frozen=True, eq=False)
class _Leaking(Descent[NoMemory]):
    """Gradient descent with a leak."""

    leakage: float = 0.1
    prior: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_number(self.leakage, "leakage rate: expected a positive number")
        prior = np.zeros(len(self.gain)) if self.prior is None else self.prior
        object.__setattr__(self, "prior", frozen_array(prior, (len(self.gain),), "leakage: prior"))

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """
        Update the estimate by a gradient step and an implicit Euler step of the leakage.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : NoMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and NoMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        share = period.dt * self._rate(period)
        moved = estimate - self.applied(period.gradient(period.integral))
        return (1.0 / (1.0 + share)) * (moved + share * column(self.prior)), memory

    @abstractmethod
    def _rate(self, period: Period) -> Any:
        """Rate of the leak in 1/s in a control period."""


@dataclass(frozen=True, eq=False)
class SigmaModification(_Leaking):
    r"""
    Gradient adaptation with constant leakage towards a prior estimate (sigma-modification).

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    leakage : float, default 0.1
        Rate sigma of the leakage in 1/s. At 0.1 its time constant is 10 s, slow compared with adaptation.
    prior : array_like, optional
        Prior estimate (k,) in SI units, zero unless given.

    Raises
    ------
    InputError
        If the gain is not positive definite, the leakage not positive, or the prior of another size.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma Y^\top s-\sigma(\hat\beta-\beta_0).

    Error and estimate stay bounded under bounded disturbances [1]_.

    References
    ----------
    .. [1] Ioannou and Kokotovic, Automatica, 1984.

    Examples
    --------
    >>> leaky = adaptctl.control.SigmaModification(np.full(6, 0.1), leakage=0.2)
    >>> leaky.prior.shape
    (6,)
    """

    tunable = ("gain", "leakage", "prior")

    def _rate(self, period: Period) -> Any:
        return self.leakage


@dataclass(frozen=True, eq=False)
class EModification(_Leaking):
    r"""
    Gradient adaptation with leakage in proportion to the sliding variable (e-modification).

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    leakage : float, default 0.1
        Leakage nu in 1/rad (1/m). At 0.1 and s = 1 rad/s it is the default rate of `SigmaModification`.
    prior : array_like, optional
        Prior estimate (k,) in SI units, zero unless given.

    Raises
    ------
    InputError
        If the gain is not positive definite, the leakage not positive, or the prior of another size.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma Y^\top s-\nu\|s\|(\hat\beta-\beta_0).

    As `SigmaModification`, but without leakage at s = 0 [1]_.

    References
    ----------
    .. [1] Narendra and Annaswamy, IEEE Trans. Automatic Control, 1987.

    Examples
    --------
    >>> leaky = adaptctl.control.EModification(np.full(6, 0.1))
    >>> adaptctl.SlotineLi(model, 5.0, 4.0, leaky).dof
    2
    """

    tunable = ("gain", "leakage", "prior")

    def _rate(self, period: Period) -> Any:
        s = period.mean
        return self.leakage * sqrt(s @ s)
