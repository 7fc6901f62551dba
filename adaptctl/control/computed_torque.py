"""Computed torque with given parameters, right or wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from adaptctl.control.controller import Controller, ReferencePoint, home
from adaptctl.control.gains import per_joint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.mechanism.pose import Array, frozen_array
from adaptctl.scalars import Column


class Followed(NamedTuple):
    """The state of a law that remembers only where the loops, if any, are followed from."""

    q: Any
    """(n,) the tree's joints at the last tick"""


@dataclass(frozen=True, eq=False)
class ComputedTorque(Controller[Followed]):
    """Inverse dynamics with a linear error loop (Luh, Walker and Paul 1980).

        torque = M(p) (a_d - 2 zeta omega e' - omega^2 e) + C(p, v) v + g(p)

    With the true parameters every joint's error decays at `bandwidth` omega (1/s, scalar or (r,)) and
    damping ratio zeta; with wrong ones it does not, and nothing learns. `parameters` (P,) are the
    mechanism's own unless given.
    """

    mechanism: Mechanism
    bandwidth: Array
    damping_ratio: float = 1.0
    parameters: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bandwidth", per_joint(self.bandwidth, self.dof, "bandwidth"))
        if not (np.isfinite(self.damping_ratio) and self.damping_ratio > 0.0):
            raise InputError(f"damping ratio: expected a positive number, got {self.damping_ratio}")
        own = self.mechanism.inertial_parameters
        given = frozen_array(own if self.parameters is None else self.parameters, own.shape, "parameters")
        object.__setattr__(self, "parameters", given)

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.mechanism.dof

    @property
    def home(self) -> Array:
        """Positions (r,) where loops, if any, are known to close."""
        return home(self.mechanism)

    def start(self, p: Array, v: Array) -> Followed:
        """The configuration at the start."""
        return Followed(self.mechanism.configuration(p))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Followed) -> tuple[Column, Followed]:
        """One tick."""
        rate, stiffness, parameters = self._constants
        q = self.mechanism.equations.closed(p, memory.q)
        a = reference.a - rate * (v - reference.v) - stiffness * (p - reference.p)
        return self.mechanism.equations.inverse_dynamics(q, v, v, a, parameters), Followed(q)

    @cached_property
    def _constants(self) -> tuple[Column, Column, Column]:
        rate, stiffness = 2.0 * self.damping_ratio * self.bandwidth, self.bandwidth**2
        return Column(rate.tolist()), Column(stiffness.tolist()), Column(np.asarray(self.parameters).tolist())
