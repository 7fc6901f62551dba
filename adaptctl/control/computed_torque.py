"""Computed torque and PD control."""

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
    """Last configuration (n,) of kinematic loops."""

    q: Any


class ModelBased(Controller[BranchState]):
    """Base class of laws with given parameters (P,)."""

    sparse = ("parameters",)

    mechanism: Mechanism
    parameters: Array | None

    def _settle(self) -> None:
        self._validate_mechanism()
        own = self.mechanism.inertial_parameters
        given = frozen_array(own if self.parameters is None else self.parameters, own.shape, "parameters")
        object.__setattr__(self, "parameters", given)

    def _validate_mechanism(self) -> None:
        validate_kind(self.mechanism, Mechanism, type(self).__name__, "as load(...) gives one")

    @property
    def dof(self) -> int:
        """Number r of primary joints."""
        return self.mechanism.dof

    @property
    def neutral_configuration(self) -> Array:
        """Neutral positions (r,) in rad (m)."""
        return self.mechanism.neutral_configuration

    def initial_state(self, p: Array, v: Array) -> BranchState:
        """Configuration (..., n) at positions (..., r)."""
        return BranchState(self.mechanism.configuration(p))

    @property
    def _parameters(self) -> Column:
        return column(self.parameters)


def embedded_parameters(model: ReducedModel, parameters: ArrayLike | None) -> Array:
    """Parameters (P,) of k ones, the removed ones zero."""
    return model.embed(model.fundamental_parameters if parameters is None else parameters)


@dataclass(frozen=True, eq=False)
class ComputedTorque(ModelBased):
    r"""
    Computed torque (inverse dynamics control) with a linear error loop.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    bandwidth : array_like
        Natural frequency omega of the error loop in rad/s, one number or (r,).
    damping_ratio : float, default 1.0
        Damping ratio zeta of the error loop without a unit; 1 is critical: the fastest without overshoot.
    parameters : array_like, optional
        All inertial and friction parameters (P,) in SI units, the mechanism's own unless given.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or bandwidth or damping ratio is not positive.

    Notes
    -----
    .. math:: \tau=M(p)(a_d-2\zeta\omega\dot e-\omega^2e)+C(p,v)v+g(p).

    With the true parameters, errors decay as designed [1]_.

    References
    ----------
    .. [1] Luh, Walker and Paul, IEEE Trans. Automatic Control, 1980.

    Examples
    --------
    >>> controller = adaptctl.ComputedTorque(arm, bandwidth=8.0)
    >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))
    >>> torque.shape
    (2,)
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
    def from_model(
        cls, model: ReducedModel, bandwidth: ArrayLike, damping_ratio: float = 1.0, parameters: ArrayLike | None = None
    ) -> ComputedTorque:
        """
        Return computed torque with the k parameters of a reduced model.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        bandwidth : array_like
            Natural frequency of the error loop in rad/s, one number or (r,).
        damping_ratio : float, default 1.0
            Damping ratio zeta of the error loop without a unit; 1 is critical: the fastest without overshoot.
        parameters : array_like, optional
            Parameters (k,) in SI units. Default: those of the model's mechanism.

        Returns
        -------
        ComputedTorque
            Controller whose torques are those of the model with these parameters.

        Raises
        ------
        InputError
            If a shape is wrong, a number is not finite, or bandwidth or damping ratio is not positive.

        Examples
        --------
        >>> adaptctl.ComputedTorque.from_model(model, bandwidth=8.0).dof
        2
        """
        return cls(model.mechanism, np.asarray(bandwidth), damping_ratio, embedded_parameters(model, parameters))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: BranchState) -> tuple[Column, BranchState]:
        """
        Compute the torque for the desired acceleration plus linear feedback of the tracking error.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : BranchState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and BranchState
            Torque (r,) in N m (N) and internal state after the period.

        Examples
        --------
        >>> controller = adaptctl.control.ComputedTorque.from_model(model, 10.0)
        >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))  # evaluates the compiled law
        >>> torque.shape
        (2,)
        """
        omega = column(self.bandwidth)
        rate, stiffness = (2.0 * self.damping_ratio) * omega, omega * omega
        q = self.mechanism.equations.closed(p, memory.q)
        a = reference.a - rate * (v - reference.v) - stiffness * (p - reference.p)
        return self.mechanism.equations.inverse_dynamics(q, v, v, a, self._parameters), BranchState(q)


@dataclass(frozen=True, eq=False)
class PDGravity(ModelBased):
    r"""
    PD control with gravity compensation.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    stiffness : array_like
        Stiffness Kp in N m/rad (N/m for a prismatic joint), one number or (r,).
    damping : array_like
        Damping Kd in N m s/rad (N s/m), one number or (r,).
    parameters : array_like, optional
        All inertial and friction parameters (P,) in SI units, the mechanism's own unless given.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or a gain is not positive.

    Notes
    -----
    .. math:: \tau=g(p)-K_p(p-p_d)-K_d(v-v_d).

    With the true gravity, a constant reference is reached from anywhere [1]_.

    References
    ----------
    .. [1] Takegaki and Arimoto, ASME J. Dynamic Systems, Measurement and Control, 1981.

    Examples
    --------
    >>> controller = adaptctl.control.PDGravity(arm, stiffness=50.0, damping=[6.0, 2.0])
    >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))
    >>> torque.shape
    (2,)
    """

    tunable = ("stiffness", "damping", "parameters")

    # accelerations are not used, so no torque would show that one is not finite
    finite: ClassVar[Finite] = True

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
    def from_model(
        cls, model: ReducedModel, stiffness: ArrayLike, damping: ArrayLike, parameters: ArrayLike | None = None
    ) -> PDGravity:
        """
        Return PD control with gravity compensation by the k parameters of a reduced model.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        stiffness : array_like
            Stiffness in N m/rad (N/m for a prismatic joint), one number or (r,).
        damping : array_like
            Damping in N m s/rad (N s/m), one number or (r,).
        parameters : array_like, optional
            Parameters (k,) in SI units. Default: those of the model's mechanism.

        Returns
        -------
        PDGravity
            Controller whose gravity torques are those of the model with these parameters.

        Raises
        ------
        InputError
            If a shape is wrong, a number is not finite, or a gain is not positive.

        Examples
        --------
        >>> adaptctl.control.PDGravity.from_model(model, stiffness=50.0, damping=[6.0, 2.0]).dof
        2
        """
        return cls(model.mechanism, np.asarray(stiffness), np.asarray(damping), embedded_parameters(model, parameters))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: BranchState) -> tuple[Column, BranchState]:
        """
        Compute gravity, spring and damper torques.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : BranchState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and BranchState
            Torque (r,) in N m (N) and internal state after the period.

        Examples
        --------
        >>> controller = adaptctl.control.PDGravity.from_model(model, [40.0, 10.0], [6.0, 2.0])
        >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))  # evaluates the compiled law
        >>> torque.shape
        (2,)
        """
        equations, rest = self.mechanism.equations, Column.zeros(self.dof)
        q = equations.closed(p, memory.q)
        gravity = equations.inverse_dynamics(q, rest, rest, rest, self._parameters)
        e, e_rate = p - reference.p, v - reference.v
        return gravity - column(self.stiffness) * e - column(self.damping) * e_rate, BranchState(q)
