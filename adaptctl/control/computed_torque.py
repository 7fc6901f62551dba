"""Computed torque with given parameters, right or wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import per_joint
from adaptctl.control.model_based import Followed, ModelBased, embedded
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column


@dataclass(frozen=True, eq=False)
class ComputedTorque(ModelBased):
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
        self._settle()

    @classmethod
    def on(
        cls, model: ReducedModel, bandwidth: ArrayLike, damping_ratio: float = 1.0, parameters: ArrayLike | None = None
    ) -> ComputedTorque:
        """The same law with the parameters (k,) of a model, the true ones unless given."""
        return cls(model.mechanism, np.asarray(bandwidth), damping_ratio, embedded(model, parameters))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Followed) -> tuple[Column, Followed]:
        """One tick."""
        rate, stiffness = self._constants
        q = self.mechanism.equations.closed(p, memory.q)
        a = reference.a - rate * (v - reference.v) - stiffness * (p - reference.p)
        return self.mechanism.equations.inverse_dynamics(q, v, v, a, self._parameters), Followed(q)

    @cached_property
    def _constants(self) -> tuple[Column, Column]:
        rate, stiffness = 2.0 * self.damping_ratio * self.bandwidth, self.bandwidth**2
        return Column(rate.tolist()), Column(stiffness.tolist())
