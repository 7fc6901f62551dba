"""Composite adaptation: tracking error and torque prediction error together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.prediction import Filtered, TorqueFilter, require_cutoff, require_positive
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each
from adaptctl.scalars.column import combined


@dataclass(frozen=True, eq=False)
class Composite(Descent[Filtered]):
    """Composite adaptation, by the tracking and the prediction error (Slotine and Li 1989).

        estimate' = -Gamma (Y's + W'R (W estimate - F[tau]))

    s (r,) is the sliding variable in rad/s (m/s), Y (r, k) the torque regressor, W (r, k) that behind the filter
    F = lambda/(d/dt + lambda), from positions and velocities alone. `gain` is Gamma, (k,) its diagonal or (k, k), in
    units of the parameters squared per J; `weight` is R (r,) in 1/(N m s) (its diagonal, one number or one a joint),
    `cutoff` is lambda in 1/s. Raises `InputError` for a gain that is not positive definite and a weight that is not
    positive, and, with a controller, for other sizes and for a cutoff that is not positive or above 1/T_c.

    Guarantees, without disturbance: with eps = W error, V = s'Ms/2 + error' Gamma^-1 error/2 falls as -s'Ks - eps'R
    eps: besides s, what the torques say of the parameters goes to zero, and under persistent excitation s and the error
    go to zero exponentially. Sampled, the second part is solved implicitly, so that no weight is too large for the
    period.

    Gives up: the torque that is commanded must be the torque that acts: friction that is no parameter, actuator lag and
    delay are learned as inertia. Noise of velocities enters W with the gain lambda, and pulls the estimate to zero
    along what is little excited: choose lambda about as fast as the motion. Without excitation it drifts under
    disturbance as `Gradient` does, but not along what W sees. Costs the momenta's regressor and r filters for each
    parameter.
    """

    tunable = ("gain", "weight", "cutoff")

    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self.cutoff)
        positive_per_joint(self.weight, np.size(self.weight), "composite: weight")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless there is a gain for each of the model's k parameters and one positive weight or one
        for each joint, and cutoff is positive and times period at most 1.

        `initial` is the first estimate (k,), `period` the control period T_c in s.
        """
        super().require(model, initial, period)
        positive_per_joint(self.weight, model.mechanism.dof, "composite: weight")
        require_cutoff(self.cutoff, period)

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Filtered:
        """The memory before the first tick: the filters at rest.

        `initial` is the first estimate (k,), q (n,) the configuration of the tree's joints in rad (m), v (r,) the
        velocities in rad/s (m/s), `period` T_c in s.
        """
        return TorqueFilter(self.cutoff, period).start(model, q, v)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Filtered) -> tuple[Column, Filtered]:
        """The estimate (k,) after a trapezium step for the tracking error, then an implicit one for the prediction
        error; and the filters' memory.

        `estimate` (k,), in the parameters' SI units, and `memory` are those before the control period `period`.
        """
        moved = estimate - self.applied(period.gradient(period.integral))
        rows, torque, after = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory)
        loaded = [self.applied(row) for row in rows]
        firm = Column(1.0 / (weight * period.length) for weight in each(self.weight, model.mechanism.dof))
        force = solve_symmetric(_products(rows, loaded, firm), residual(rows, moved, torque))
        return moved - period.share * combined(loaded, force), after


def residual(rows: list[Column], estimate: Column, torque: Column) -> Column:
    """The prediction error W estimate - torque (r,), in N m (N for a prismatic joint), for the rows of W (r, k), an
    estimate (k,) and filtered torques (r,)."""
    return Column(row @ estimate for row in rows) - torque


def _products(rows: list[Column], loaded: list[Column], firm: Column) -> list[list[Scalar]]:
    """W Gamma W' + (R T_c)^-1 (r, r), each entry of the symmetric matrix once."""
    r = len(rows)
    lower = [[rows[i] @ loaded[j] for j in range(i + 1)] for i in range(r)]
    for i in range(r):
        lower[i][i] = lower[i][i] + firm[i]
    return [[lower[max(i, j)][min(i, j)] for j in range(r)] for i in range(r)]
