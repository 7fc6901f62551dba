"""Control laws with given parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.controller import Controller
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


class BranchState(NamedTuple):
    """The memory of a law without learning: the configuration q (n,), from which a mechanism's loops are followed."""

    q: Any
    """(n,) the tree's joints at the last tick, from which the next configuration is found"""


class ModelBased(Controller[BranchState]):
    """Base class of control laws with parameters (P,), right or wrong, of a mechanism; its own unless given."""

    mechanism: Mechanism
    parameters: Array | None

    def _settle(self) -> None:
        """Check the parameters, the mechanism's own unless given, and freeze them."""
        own = self.mechanism.inertial_parameters
        given = frozen_array(own if self.parameters is None else self.parameters, own.shape, "parameters")
        object.__setattr__(self, "parameters", given)

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.mechanism.dof

    @property
    def home(self) -> Array:
        """Positions (r,), rad or m, where loops, if any, are known to close."""
        return self.mechanism.home

    def start(self, p: Array, v: Array) -> BranchState:
        """The memory before the first tick: the configuration at p (..., r)."""
        return BranchState(self.mechanism.configuration(p))

    @property
    def _parameters(self) -> Column:
        return column(np.asarray(self.parameters))


def embedded_parameters(model: ReducedModel, parameters: ArrayLike | None) -> Array:
    """Parameters (P,) with the torques of fundamental ones (k,), the true ones unless given: zero where removed, so
    that what they would have cost is never computed."""
    return model.embed(model.fundamental_parameters if parameters is None else parameters)
