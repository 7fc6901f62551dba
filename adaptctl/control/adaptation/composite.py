"""Composite adaptation: tracking error and torque prediction error together."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.prediction import (
    Filtered,
    TorqueFilter,
    require_cutoff,
    require_no_known_share,
    require_positive,
)
from adaptctl.control.gains.gains import positive_numbers, positive_per_joint
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each
from adaptctl.scalars.column import combined


@dataclass(frozen=True, eq=False)
class Composite(Descent[Filtered]):
    """Composite adaptation of the estimate (k,) of k parameters, by the tracking and the prediction error (Slotine and
    Li 1989).

        estimate' = -Gamma (Y' s + W'R (W estimate - F[tau]))

    s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic joint), tau (r,) the torque in N m (N), Y
    (r, k) the torque regressor, W (r, k) that behind the filter F = lambda/(d/dt + lambda), from positions and
    velocities alone. `gain` is Gamma, (k,) its diagonal or (k, k), in units of the parameters squared per J; `weight`
    is R's diagonal, one number or (r,), in 1/(N m s) (m/(N s)); `cutoff` is lambda in rad/s. A prime is the transpose,
    but on estimate a derivative in time. Raises `InputError` at construction for a gain that is not finite, symmetric
    and positive definite, and a weight or cutoff that is not positive and finite (a weight of NaN is a
    `NonFiniteError`), and, with a controller, for sizes that do not fit the model, linear constraints on parameters
    that fix some at values other than zero, and a cutoff above 1/T_c, T_c the control period.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: with the prediction error eps = W error, V = s'Ms/2 + error' Gamma^-1 error/2 has the time derivative
    -s'Ks - eps'R eps: s and eps go to zero, and under persistent excitation s and the error go to zero exponentially.
    Sampled, the step for the prediction error is solved implicitly, so that no weight is too large for the period.

    Gives up: the torque that is commanded must be the torque that acts: friction that is no parameter, actuator lag and
    delay are learned as inertia. Noise of velocities enters W with the gain lambda, and pulls the estimate to zero
    along what is little excited: choose lambda about as fast as the motion. Without excitation the estimate drifts
    under disturbance along what W does not see. Costs the evaluation of the momenta's regressor and r filters for each
    parameter.
    """

    tunable = ("gain", "weight", "cutoff")

    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self.cutoff)
        positive_numbers(self.weight, "composite: weight")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain for k parameters, one positive weight of prediction errors or
        one for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, and no linear constraint that fixes
        a parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        super().require(model, initial, period)
        require_no_known_share(model, "composite")
        positive_per_joint(self.weight, model.mechanism.dof, "composite: weight")
        require_cutoff(self.cutoff, period)

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Filtered:
        """The internal state before the first control period, a `Filtered`: the torque filters with zero output, that
        is, a filtered regressor and filtered torques of zero.

        `initial`, the initial estimate (k,) of k parameters, is not looked at; q (..., n) are the positions of the
        spanning tree's n joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary
        (independent) joints in rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field
        `regressor` then has them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear
        constraints fix parameters at values other than zero; nothing else is checked.
        """
        return TorqueFilter(self.cutoff, period).start(model, q, v)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Filtered) -> tuple[Column, Filtered]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the torque filters' internal state
        after a control period. The estimate takes a step for the tracking error (trapezium rule), then an implicit one
        for the prediction error.

        `estimate` (k,) and `memory`, the torque filters' internal state, are those before the control period that
        `period` describes. Nothing is checked here.
        """
        moved = estimate - self.applied(period.gradient(period.integral))
        rows, torque, after = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory)
        loaded = [self.applied(row) for row in rows]
        firm = Column(1.0 / (weight * period.length) for weight in each(self.weight, model.mechanism.dof))
        force = solve_symmetric(_products(rows, loaded, firm), residual(rows, moved, torque))
        return moved - period.share * combined(loaded, force), after


def residual(rows: list[Column], estimate: Column, torque: Column) -> Column:
    """The prediction error W estimate - torque (r,) of r joints, in N m (N for a prismatic joint): predicted less
    filtered torques. `rows` are the r rows (k,) of the filtered torque regressor W, in N m (N) per unit of each of k
    parameters, `estimate` (k,) is in SI units, `torque` (r,) are the filtered torques in N m (N). Raises `ValueError`
    for columns of other lengths."""
    return Column(row @ estimate for row in rows) - torque


def _products(rows: list[Column], loaded: list[Column], firm: Column) -> list[list[Scalar]]:
    """W Gamma W' + (R T_c)^-1 (r, r), each entry of the symmetric matrix once."""
    r = len(rows)
    lower = [[rows[i] @ loaded[j] for j in range(i + 1)] for i in range(r)]
    for i in range(r):
        lower[i][i] = lower[i][i] + firm[i]
    return [[lower[max(i, j)][min(i, j)] for j in range(r)] for i in range(r)]
