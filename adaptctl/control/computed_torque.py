"""Computed torque with given parameters, right or wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, positive_number, positive_per_joint
from adaptctl.compilation.builtin import Finite
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import validate_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


class BranchState(NamedTuple):
    """Internal state of a control law that learns nothing: the configuration `q` (n,) of all n joints of the
    mechanism's spanning tree in the last control period, rad (m if prismatic). With closed kinematic loops the next
    configuration is found from it. Nothing is checked."""

    q: Any


class ModelBased(Controller[BranchState]):
    """Base class of control laws for a `mechanism` with given `parameters` (P,), right or wrong: all its P inertial and
    friction parameters in SI units and the order of `Mechanism.parameter_names`, None for the mechanism's own. A
    subclass is a frozen dataclass that writes the method `law(p, v, reference, memory)`, which returns the torque (r,)
    of r joints and the `BranchState` after it. It calls `self._settle()` at construction, which raises `InputError` for
    parameters of another shape or not finite."""

    sparse = ("parameters",)

    mechanism: Mechanism
    parameters: Array | None

    def _settle(self) -> None:
        """Check the parameters, the mechanism's own unless given, and freeze them."""
        self._validate_mechanism()
        own = self.mechanism.inertial_parameters
        given = frozen_array(own if self.parameters is None else self.parameters, own.shape, "parameters")
        object.__setattr__(self, "parameters", given)

    def _validate_mechanism(self) -> None:
        """Raise `InputError` for what is no mechanism, such as a robot's name."""
        validate_kind(self.mechanism, Mechanism, type(self).__name__, "as load(...) gives one")

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary (independent) joints, which the control law moves; kinematic loops, if
        any, move the others."""
        return self.mechanism.dof

    @property
    def neutral_configuration(self) -> Array:
        """Positions (r,) of the r primary (independent) joints, rad (m if prismatic), at the mechanism's home
        configuration, where its kinematic loops are known to close; zeros without loops."""
        return self.mechanism.neutral_configuration

    def initial_state(self, p: Array, v: Array) -> BranchState:
        """The internal state before the first control period, a `BranchState`: the configuration (..., n), rad (m if
        prismatic), of all n joints of the mechanism's spanning tree at positions `p` (..., r) of its r primary
        (independent) joints. `v` is not used. Raises `InputError` on a wrong shape of p, `NonFiniteError` on NaN or
        infinity in it, `SingularityError` near a singularity of the kinematic loops."""
        return BranchState(self.mechanism.configuration(p))

    @property
    def _parameters(self) -> Column:
        return column(self.parameters)


def embedded_parameters(model: ReducedModel, parameters: ArrayLike | None) -> Array:
    """All P inertial and friction parameters (P,), SI units, of the `model`'s mechanism that give the same torques as
    its k fundamental (base) `parameters` (k,), None for the true ones. The parameters that the model has removed are
    zero, so that their terms are never computed. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or
    infinity."""
    return model.embed(model.fundamental_parameters if parameters is None else parameters)


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
        self._validate_mechanism()
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
        self._validate_mechanism()
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
