"""Proportional and derivative control with gravity compensated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.compilation.builtin import Finite
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.control.model_based import BranchState, ModelBased, embedded_parameters
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


@dataclass(frozen=True, eq=False)
class PDGravity(ModelBased):
    """PD control with gravity compensation: torque = g(p) - Kp (p - p_d) - Kd (v - v_d) (Takegaki and Arimoto 1981).

    p and v are the measured positions and velocities of r joints, p_d and v_d the desired ones, e = p - p_d, g
    gravity's torque and M the mass matrix; a prime is the transpose.

    Guarantees, with the true gravity: a p_d that stands still is reached from anywhere, as v'Mv/2 + e'Kp e/2 falls at
    the rate v'Kd v, for any inertias.

    Gives up: a moving reference is followed with the error that inertia and Coriolis forces make; a wrong gravity
    leaves the error Kp^-1 times what is missing. Nothing learns.

    `stiffness` is Kp in N m/rad (N/m for a prismatic joint) and `damping` Kd in N m s/rad (N s/m), each one number or
    (r,); `parameters` (P,), all P inertial and friction ones, are in SI units and the order of
    `Mechanism.parameter_names`, None for the `mechanism`'s own. The class attribute `finite` is True: a step refuses
    NaN and infinity in its arguments too, by `NonFiniteError`. Raises `InputError` on wrong shapes, for numbers that
    are not finite, and for gains that are not positive.
    """

    tunable = ("stiffness", "damping", "parameters")

    finite: ClassVar[Finite] = True
    """Accelerations are not used, so no torque tells that one is not finite."""

    mechanism: Mechanism
    stiffness: Array
    damping: Array
    parameters: Array | None = None

    def __post_init__(self) -> None:
        self._require_mechanism()
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, positive_per_joint(getattr(self, name), self.dof, name))
        self._settle()

    @classmethod
    def on(
        cls, model: ReducedModel, stiffness: ArrayLike, damping: ArrayLike, parameters: ArrayLike | None = None
    ) -> PDGravity:
        """PD control law with gravity compensation, a `PDGravity`, on a reduced `model`. `parameters` (k,) are the
        model's k fundamental (base) parameters in SI units, None for the true ones. `stiffness` is in N m/rad (N/m for
        a prismatic joint) and `damping` in N m s/rad (N s/m), one number or one for each of r joints (r,). Raises
        `InputError` for numbers of the wrong shape or not finite, and for gains that are not positive."""
        return cls(model.mechanism, np.asarray(stiffness), np.asarray(damping), embedded_parameters(model, parameters))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: BranchState) -> tuple[Column, BranchState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, gravity's less a spring's
        and a damper's, and the internal state after it: the positions (n,) of all n joints of the spanning tree.
        Measured positions p are in rad (m) and velocities v in rad/s (m/s), (r,); `reference` has positions, rad (m),
        and velocities, rad/s (m/s), (r,) each, its accelerations are not used; `memory` is the internal state of the
        last control period. Nothing is checked here: the method `step` checks shapes."""
        equations, rest = self.mechanism.equations, Column.zeros(self.dof)
        q = equations.closed(p, memory.q)
        gravity = equations.inverse_dynamics(q, rest, rest, rest, self._parameters)
        e, e_rate = p - reference.p, v - reference.v
        return gravity - column(self.stiffness) * e - column(self.damping) * e_rate, BranchState(q)
