"""Control laws with given parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.controller import Controller
from adaptctl.dynamics import Mechanism
from adaptctl.errors import require_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


class BranchState(NamedTuple):
    """Internal state of a control law that learns nothing: the configuration `q` (n,) of all n joints of the
    mechanism's spanning tree in the last control period, rad (m if prismatic). With closed kinematic loops the next
    configuration is found from it. Nothing is checked."""

    q: Any
    """(n,) the tree's joints in the last control period, from which the next configuration is found"""


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
        self._require_mechanism()
        own = self.mechanism.inertial_parameters
        given = frozen_array(own if self.parameters is None else self.parameters, own.shape, "parameters")
        object.__setattr__(self, "parameters", given)

    def _require_mechanism(self) -> None:
        """Raise `InputError` for what is no mechanism, such as a robot's name."""
        require_kind(self.mechanism, Mechanism, type(self).__name__, "as load(...) gives one")

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary (independent) joints, which the control law moves; kinematic loops, if
        any, move the others."""
        return self.mechanism.dof

    @property
    def home(self) -> Array:
        """Positions (r,) of the r primary (independent) joints, rad (m if prismatic), at the mechanism's home
        configuration, where its kinematic loops are known to close; zeros without loops."""
        return self.mechanism.home

    def start(self, p: Array, v: Array) -> BranchState:
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
