"""Gradient adaptation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, finite_number, frozen_array, numbers, whole_number
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO, scaled_eigenvalues
from adaptctl.control.pytree import Memory
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, maximum, where


@dataclass(frozen=True, eq=False)
class Descent(AdaptationLaw[Memory]):
    """Base class of laws with a constant gain, (k,) or (k, k)."""

    gain: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_gain(self.gain))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Check the gain's size."""
        validate_size(self.gain, model, "adaptation gain")

    @property
    def by_parameter(self) -> bool:
        """True if the gain is diagonal."""
        return self.gain.ndim == 1

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """Squared parameter error over twice the gain, J."""
        error, gain = estimate - true, self._columns
        if isinstance(gain, list):
            return 0.5 * (error @ self._unscaled(gain, error))
        return 0.5 * (error @ Column(e / g for e, g in zip(error, gain, strict=True)))

    def _unscaled(self, gain: list[Column], error: Column) -> Column:
        """Inverse gain times error (k,), of arrays by LAPACK."""
        if not (isinstance(self.gain, np.ndarray) and isinstance(error.of[0], np.ndarray)):
            return solve_symmetric([list(row) for row in gain], error)
        errors = np.stack(error.of)
        return Column(np.linalg.solve(self.gain, errors.reshape(len(errors), -1)).reshape(errors.shape))

    def applied(self, gradient: Column) -> Column:
        """Gain times gradient (k,)."""
        gain = self._columns
        if not isinstance(gain, list):
            return gain * gradient
        from adaptctl.control.adaptation.symmetric import rows_product  # few gains are whole matrices

        return rows_product(gain, gradient)

    @property
    def _columns(self) -> Column | list[Column]:
        rows: Any = self.gain
        if getattr(rows, "ndim", 1 + isinstance(rows, tuple)) == 2:  # an array, or a tuple of columns
            return [column(row) for row in rows]
        return column(rows)


def checked_gain(gain: ArrayLike) -> Array:
    """Read-only positive definite gain, else `InputError`."""
    array = numbers(gain, "adaptation gain")
    k = array.shape[:1]
    array = frozen_array(array, (*k, *k) if array.ndim == 2 else k, "adaptation gain")
    if array.ndim not in (1, 2) or not array.size:
        raise InputError(
            f"adaptation gain: expected numbers (k,), one per parameter, or (k, k), got shape {array.shape}"
        )
    positive = np.all(array > 0.0) if array.ndim == 1 else _is_positive_definite(array)
    if not positive:
        raise InputError("adaptation gain: expected a positive diagonal or a symmetric positive definite matrix")
    return array


def validate_size(values: Array, model: ReducedModel, what: str) -> None:
    """Raise `InputError` unless there are k rows."""
    k, given = len(model.columns), len(values)
    if given == k:
        return
    hint = ""
    if given == len(model.mechanism.parameter_names):
        hint = f"; these are for all {given} parameters, but the basis has {k}: select model.columns"
    raise InputError(f"{what}: expected {k} numbers, one per parameter of the model, got {given}{hint}")


def _is_positive_definite(matrix: Array) -> bool:
    """True if positive definite to round-off."""
    symmetric = np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12 * np.abs(matrix).max(initial=0.0))
    return bool(symmetric and np.all(np.diagonal(matrix) > 0.0) and scaled_eigenvalues(matrix)[0] > 0.0)


MIN_POWER = 1e-300  # in W, so that nothing is divided by zero where s is zero


@dataclass(frozen=True, eq=False)
class Gradient(Descent[NoMemory]):
    r"""
    Gradient adaptation, the law of Slotine and Li's theorem.

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    theta : float, default 1.0
        Weight of the sliding variable at the end of the period, without a unit. 1 is backward Euler, the most stable,
        1/2 the trapezoidal rule, 0 forward Euler.
    cap : float, default 2.0
        Bound of the power of an adaptation step beyond the stable gains, which is then at most the power of the damping
        divided by this. 0 is no bound.
    delay : int, default 0
        Control periods, 0 to 64, by which torques arrive late. The regressor is then that of the torque which arrived:
        with a later one, a ring of the loop raises the inertias that cause it.

    Raises
    ------
    InputError
        If the gain is not positive definite, theta is outside [0, 1], the cap is negative, or the delay no such number.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma Y^\top s.

    The tracking error converges to zero [1]_. Sampled at a constant mass matrix, the backward rule is stable for
    :math:`a+h<2`, :math:`a=T_c\lambda_{\max}(K^{-1}Y\Gamma Y^\top)`, :math:`h=T_c\lambda_{\max}(M^{-1}K)`. Steps at
    which V can rise are capped, the others are not; see docs/discrete_adaptation.md.

    References
    ----------
    .. [1] Slotine and Li, Int. J. Robotics Research, 1987.

    Examples
    --------
    >>> from adaptctl.control import Gradient
    >>> adaptctl.SlotineLi(model, 5.0, 4.0, Gradient(np.full(6, 0.1))).adaptation_law.theta
    1.0
    """

    tunable = ("gain",)

    theta: float = 1.0
    cap: float = 2.0
    delay: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.theta <= 1.0:
            raise InputError(f"gradient: theta: expected a number from 0 (Euler) to 1 (backward), got {self.theta}")
        finite_number(self.cap, "gradient: cap")
        whole_number(self.delay, "gradient: delay in control periods", 0, MAX_DELAY)

    @property
    def regressor_delay(self) -> int:
        """The delay of the torques, in control periods."""
        return self.delay

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """
        Update the estimate by a gradient step.

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
        s = period.s if self.theta == 1.0 else period.s_prev + self.theta * (period.s - period.s_prev)
        slope = period.gradient(s)
        step = self.applied(slope)
        return estimate - (period.dt * self._share(period, s, slope @ step)) * step, memory

    def _share(self, period: Period, s: Column, square: Any) -> Any:
        """1 where V cannot rise, otherwise a factor that bounds the step's power."""
        if self.cap == 0.0:
            return 1.0
        power = s @ (period.damping * s)
        capped = power / (power + (self.cap * period.period) * square + MIN_POWER)
        if self.theta < 0.5:
            return capped
        change = period.s - period.s_prev
        taken = (2.0 * self.theta - 1.0) * (2.0 * s - (self.theta - 1.0 + 1.0 / MAX_SAMPLING_RATIO) * change)
        room = 2.0 * power - maximum(taken @ (period.damping * change), 0.0)
        return where(period.period * square <= room, 1.0, capped)
