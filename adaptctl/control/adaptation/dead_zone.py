"""Gradient adaptation with a dead zone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_numbers, positive_per_joint
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each, where


@dataclass(frozen=True, eq=False)
class DeadZone(Descent[NoMemory]):
    r"""
    Gradient adaptation that pauses while the sliding variable is small (dead zone).

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    width : array_like, default 0.05
        Half-widths w of the dead zone, an ellipsoid, in rad/s (m/s), one number or (r,). 0.05 is a first choice where
        disturbances are not known; `for_disturbance` computes widths for known ones.

    Raises
    ------
    InputError
        If the gain is not positive definite or the width not positive.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma Y^\top s\quad\text{where}\quad\sum_i(s_i/w_i)^2>1.

    Disturbances within the zone cause no drift [1]_.

    References
    ----------
    .. [1] Peterson and Narendra, IEEE Trans. Automatic Control, 1982.

    Examples
    --------
    >>> zone = adaptctl.control.DeadZone.for_disturbance(np.full(6, 0.1), damping=[6.0, 2.0], torque=[0.3, 0.1])
    >>> zone.width.shape
    (2,)
    """

    tunable = ("gain", "width")

    width: Array = 0.05  # type: ignore[assignment]  # a number becomes an array for the model's joints

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_numbers(self.width, "dead zone: width")

    @classmethod
    def for_disturbance(cls, gain: ArrayLike, damping: ArrayLike, torque: ArrayLike) -> DeadZone:
        """
        Return the law with a dead zone that suits the size of disturbance torques.

        Parameters
        ----------
        gain : array_like
            Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per
            J.
        damping : array_like
            Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
        torque : array_like
            Largest disturbance torques in N m (N), one number or (r,).

        Returns
        -------
        DeadZone
            Law whose zone contains every s at which the disturbance could outweigh the damping.

        Raises
        ------
        InputError
            If a number is negative, sizes differ, the gain is not positive definite, or all torques are zero.

        Examples
        --------
        >>> gain = np.full(len(model.names), 0.1)
        >>> adaptctl.control.DeadZone.for_disturbance(gain, damping=[6.0, 2.0], torque=0.5).width.shape
        (2,)
        """
        joints = max(np.size(torque), np.size(damping))
        d, K = per_joint(torque, joints, "dead zone: torque"), positive_per_joint(damping, joints, "damping")
        if np.any(d < 0.0):
            raise InputError(f"dead zone: torque: expected numbers of at least 0, got {d.tolist()}")
        return cls(np.asarray(gain), np.sqrt((d**2 / K).sum() / K))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if gain or width do not fit the model.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        initial : ndarray
            Initial estimate (k,) in SI units.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If a size does not fit.
        """
        super().validate(model, initial, control_period)
        positive_per_joint(self.width, model.mechanism.dof, "dead zone: width")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """
        Update the estimate by a gradient step where the sliding variable is outside the dead zone.

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
        scaled = Column(1.0 / width for width in each(self.width, model.mechanism.dof)) * period.mean
        outside = where(scaled @ scaled > 1.0, 1.0, 0.0)
        return estimate - self.applied(period.gradient(outside * period.integral)), memory
