"""Adaptive computed torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import sub
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.adaptive import AdaptiveController, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import typical_inertia
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO, MIN_EIGENVALUE, worst_conditioned_configuration
from adaptctl.control.pytree import either
from adaptctl.dynamics.recursion.mass_matrix import factorised, solve_symmetric
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, minimum, where

MIN_PIVOT_RATIO = 0.05  # of the initial estimate's pivots, so that accelerations are amplified at most 20 times


class Rejections(NamedTuple):
    """Numbers (1,) of rejected estimates, and of restarts from the initial one."""

    rejected: Any
    restarts: Any


@dataclass(frozen=True, eq=False)
class AdaptiveComputedTorque(AdaptiveController):
    r"""
    Computed torque that adapts from measured accelerations.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Decay rate Lambda of the tracking error in 1/s, one number or (r,).
    initial : array_like
        Initial estimate (k,) in SI units, not zero: its mass matrix must be positive definite.
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    prediction_weight : array_like, optional
        Weight W of the sliding variable in kg m^2 (kg), one number or (r,). Default: the typical inertia of each joint,
        so that gains compare with those of `SlotineLi`.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.

    Raises
    ------
    GainError
        If 2 Lambda T_c is above 1.5.
    InputError
        If a shape is wrong, a number is not positive, the adaptation law does not fit the model, or the initial mass
        matrix is not positive definite.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma Y(p,v,a)^\top\hat M^{-1}Ws,\quad s=\dot e+\Lambda e.

    The tracking error converges to zero while the estimated mass matrix is positive definite [1]_, as with `Natural`.
    An estimate with a pivot of its mass matrix below a twentieth of the initial estimate's is rejected: the last one is
    kept or, where it is not definite either, the initial one. `controller_state` counts both.
    Noise needs a gain smaller by :math:`T_c\Lambda` than in `SlotineLi`.

    References
    ----------
    .. [1] Craig, Hsu and Sastry, Int. J. Robotics Research, 1987.

    Examples
    --------
    >>> controller = adaptctl.control.AdaptiveComputedTorque(model, 5.0, model.fundamental_parameters)
    >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))
    >>> torque.shape
    (2,)
    """

    tunable = ("bandwidth", "prediction_weight", "initial")

    model: ReducedModel
    bandwidth: Array
    initial: Array | None
    adaptation: AdaptationLaw[Any] | Array | None = None
    prediction_weight: Array | None = None
    control_period: float = 1e-3
    torque_limits: ArrayLike | None = None

    def __post_init__(self) -> None:
        self._validate_model()
        object.__setattr__(self, "bandwidth", positive_per_joint(self.bandwidth, self.dof, "bandwidth"))
        weight = typical_inertia(self.model.mechanism) if self.prediction_weight is None else self.prediction_weight
        object.__setattr__(self, "prediction_weight", positive_per_joint(weight, self.dof, "prediction_weight"))
        self._settle()
        if self.adaptation_law is not None and self.adaptation_law.regressor_delay:
            raise InputError("adaptive computed torque: adaptation: its regressor has no delay: use SlotineLi for one")
        self._validate_bandwidth()
        self._validate_inertia()

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """
        Compute the torque and the next state.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and AdaptiveState
            Torque (r,) in N m (N) and internal state after the period.
        """
        equations, bandwidth = self.model.mechanism.equations, column(self.bandwidth)
        q = equations.closed(p, memory.q)
        e, e_rate = p - reference.p, v - reference.v
        s = e_rate + bandwidth * e

        def gradient(sliding: Column) -> Column:
            before: Column = memory.regressor_state
            acceleration = (1.0 / self.control_period) * (v - before)
            inertia = equations.mass_matrix(memory.q, self._parameters(memory.estimate))
            weighted = solve_symmetric(inertia, column(self.prediction_weight) * sliding)
            return equations.motion(memory.q, before, before, acceleration).regressor_transpose_product(
                weighted, self.model.columns
            )

        damping = column(self.prediction_weight) * bandwidth
        passed = Period(gradient, memory.s, s, memory.torque, q, v, self.control_period, memory.dt[0], damping)
        adapted, learning = self._adapted(memory, passed)
        estimate, guard = self._definite(q, adapted, memory)
        a = reference.a - bandwidth * (e_rate + s)
        torque = equations.inverse_dynamics(q, v, v, a, self._parameters(estimate))
        return torque, AdaptiveState(estimate, q, v, s, *self._limited(torque), learning, guard)

    def _definite(self, q: Column, adapted: Column, memory: AdaptiveState) -> tuple[Column, Any]:
        """Adapted estimate, else the last or the initial one, whose mass matrix at q is positive definite."""
        if self.adaptation_law is None:
            return adapted, NoMemory()
        initial, last, counts = column(self.initial), memory.estimate, memory.controller_state
        least = [MIN_PIVOT_RATIO * pivot for pivot in self._pivots(q, initial)]
        good, kept = (_all_above(self._pivots(q, of), least) for of in (adapted, last))
        rejected, restarts = where(good, 0.0, 1.0), where(good, 0.0, where(kept, 0.0, 1.0))
        return either(good, adapted, either(kept, last, initial)), Rejections(
            counts.rejected + Column((rejected,)), counts.restarts + Column((restarts,))
        )

    def _pivots(self, q: Column, estimate: Column) -> Sequence[Scalar]:
        return factorised(self.model.mechanism.equations.mass_matrix(q, self._parameters(estimate))).pivots

    def _controller_state(self, p: Array, v: Array) -> Any:
        return NoMemory() if self.adaptation_law is None else Rejections(np.zeros(1), np.zeros(1))

    @property
    def _motion_size(self) -> int:
        return self.dof

    def _validate_bandwidth(self) -> None:
        """Raise `GainError` if a held torque overshoots."""
        gain = 2.0 * self.control_period * float(self.bandwidth.max())
        if gain > MAX_SAMPLING_RATIO:
            raise GainError(
                f"bandwidth: 2 Lambda T_c = {gain:.3g}, above the limit of {MAX_SAMPLING_RATIO}: use at most "
                f"{MAX_SAMPLING_RATIO / (2.0 * self.control_period):g} 1/s for a control period of "
                f"{self.control_period:g} s"
            )

    def _validate_inertia(self) -> None:
        smallest, p = worst_conditioned_configuration(self.model.mechanism, self.model.embed(np.asarray(self.initial)))
        if not smallest > MIN_EIGENVALUE:
            raise InputError(
                "adaptive computed torque: needs an initial estimate whose mass matrix is positive definite "
                f"everywhere, but the given one, with its diagonal scaled to 1, has the eigenvalue {smallest:.3g} at p "
                f"= {np.round(p, 3).tolist()}: start from a rough model of the arm, or use SlotineLi, which can start "
                "from zero"
            )


def _all_above(numbers: Sequence[Scalar], least: Sequence[Scalar]) -> Any:
    """True if no number is below its bound."""
    return reduce(minimum, map(sub, numbers, least)) >= 0.0
