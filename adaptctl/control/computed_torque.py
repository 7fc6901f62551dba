"""Computed torque with given parameters, right or wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.control.model_based import BranchState, ModelBased, embedded_parameters
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


@dataclass(frozen=True, eq=False)
class ComputedTorque(ModelBased):
    """Computed torque, or inverse dynamics control, of r joints with a linear error loop (Luh, Walker and Paul 1980).

        torque = M(p) (a_d - 2 zeta omega e' - omega^2 e) + C(p, v) v + g(p)

    M is the mass matrix, C the Coriolis matrix, g the gravity torque, all of `parameters`, at measured positions p and
    velocities v (r,); p_d and a_d are the reference's positions and accelerations, the torque (r,) is in N m (N for a
    prismatic joint). With the true parameters every joint's error e = p - p_d, e' its derivative in time, decays at
    `bandwidth` omega (rad/s, one number or (r,)) and damping ratio zeta (`damping_ratio`, no unit; 1 is critical); with
    wrong ones it does not, and nothing learns. `parameters` (P,), all P inertial and friction ones of the mechanism,
    are in SI units, None for the `mechanism`'s own. Raises `InputError` on wrong shapes, for numbers that are not
    finite, and for a bandwidth or damping ratio that is not positive.
    """

    tunable = ("bandwidth", "damping_ratio", "parameters")

    mechanism: Mechanism
    bandwidth: Array
    damping_ratio: float = 1.0
    parameters: Array | None = None

    def __post_init__(self) -> None:
        self._require_mechanism()
        object.__setattr__(self, "bandwidth", positive_per_joint(self.bandwidth, self.dof, "bandwidth"))
        positive_number(self.damping_ratio, "damping ratio: expected a positive number")
        self._settle()

    @classmethod
    def on(
        cls, model: ReducedModel, bandwidth: ArrayLike, damping_ratio: float = 1.0, parameters: ArrayLike | None = None
    ) -> ComputedTorque:
        """Computed-torque control law, a `ComputedTorque`, on a reduced `model` of k fundamental (base) parameters.
        `bandwidth` is the error loop's natural frequency in rad/s, one number or one for each of r joints (r,);
        `damping_ratio` has no unit, 1, the default, is critical; `parameters` (k,) are in SI units, None for the
        model's own, the true ones. Raises `InputError` for numbers of the wrong shape or not finite, and for a
        bandwidth or damping ratio that is not positive."""
        return cls(model.mechanism, np.asarray(bandwidth), damping_ratio, embedded_parameters(model, parameters))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: BranchState) -> tuple[Column, BranchState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, and the internal state
        after it: the positions (n,) of all n joints of the spanning tree. The torque is the inverse dynamics of the
        acceleration that brings the tracking error back to zero. Measured positions p are in rad (m), velocities v in
        rad/s (m/s), (r,); `reference` has the desired positions, velocities and accelerations (r,), in rad, rad/s and
        rad/s^2 (m, m/s and m/s^2 if prismatic); `memory` is the internal state of the last control period. Nothing is
        checked here: the method `step` checks shapes."""
        omega = column(self.bandwidth)
        rate, stiffness = (2.0 * self.damping_ratio) * omega, omega * omega
        q = self.mechanism.equations.closed(p, memory.q)
        a = reference.a - rate * (v - reference.v) - stiffness * (p - reference.p)
        return self.mechanism.equations.inverse_dynamics(q, v, v, a, self._parameters), BranchState(q)
