"""Changes of a controller's state from outside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Controller
from adaptctl.control.energy_tank import EnergyTank
from adaptctl.control.impedance import JointImpedance
from adaptctl.control.pytree import leaves, paths

NAMES = ("torque", "dt", "q", "estimate", "moving", "tank", "felt", "acted")
TANK = "controller_state"
"""part of a state that is an impedance's tank"""


class HeldState:
    """
    Editor of a controller's states, for loops that limit torques or distrust a period.

    Parameters
    ----------
    controller : Controller
        Controller with r joints, alone or in a safety filter.

    Examples
    --------
    >>> from adaptctl.control import HeldState
    >>> state = HeldState(law).without_learning(law.init(p, v), torque=np.array([1.0, 2.0]))
    >>> state.torque, state.dt
    (array([1., 2.]), array([0.]))
    """

    def __init__(self, controller: Controller[Any]) -> None:
        self._controller, self._size, self._law = controller, 0, _innermost(controller)
        self._places: dict[str, list[slice]] = {name: [] for name in NAMES}
        inner = max((path.count(".inner") for path in paths(controller._blank)), default=0)
        for path, part in zip(paths(controller._blank), leaves(controller._blank), strict=True):
            here = slice(self._size, self._size + np.shape(part)[-1])
            parents, _, name = path.rpartition(".")
            own = set(parents.split(".")) <= {"state", "inner"}
            if name in ("dt", "moving") or (own and name in ("torque", "q", "estimate")):
                self._places[name].append(here)
            if name in EnergyTank._fields and parents.endswith(TANK):
                self._places["tank"].append(here)
            if name == "torque" and own and parents.count(".inner") == inner:
                self._places["acted"].append(here)
            if name == "felt" and parents.endswith(TANK):
                self._places["felt"].append(here)
            if name == "trusted" and parents.endswith(TANK):
                self._places["estimate"].append(here)
            self._size = here.stop

    def without_learning(self, state: Any, torque: Array) -> Any:
        """
        Return a state that learns nothing from the period that begins.

        Parameters
        ----------
        state : tuple
            Internal state of one arm.
        torque : ndarray
            Torque (r,) that was applied in N m (N).

        Returns
        -------
        tuple
            Internal state.
        """
        return self._edited(state, torque=torque, dt=0.0)

    @property
    def feels(self) -> bool:
        """True if the controller takes measured external torques, as an impedance without a tank does."""
        return isinstance(self._law, JointImpedance) and self._law.tank is None

    @property
    def driven(self) -> bool:
        """True if it needs them, since they drive a target inertia."""
        return self.feels and self._law.force_cutoff is not None

    def feeling(self, state: Any, torque: Array, external: Array) -> Any:
        """
        Return a state that knows of a measured external torque.

        Parameters
        ----------
        state : tuple
            Internal state of one arm.
        torque : ndarray
            Torque (r,) that was applied over the last period in N m (N).
        external : ndarray
            External torque (r,) on the arm in N m (N).

        Returns
        -------
        tuple
            Internal state: the torque drives a target inertia, and the arm's model is learned from what acted in all.

        Examples
        --------
        >>> from adaptctl.control import HeldState
        >>> HeldState(law).feeling(law.init(p, v), np.array([1.0, 2.0]), np.array([0.5, 0.0])).torque
        array([1.5, 2. ])
        """
        return self._edited(state, felt=external, acted=torque + external)

    def unsettled(self, state: Any) -> Any:
        """
        Return a state whose torque filters, which assume equal periods, settle again before anything is stored.

        Parameters
        ----------
        state : tuple
            Internal state of one arm after a period that was not on time.

        Returns
        -------
        tuple
            Internal state.
        """
        return self._edited(state, moving=0.0)

    def with_estimate(self, state: Any, estimate: Array) -> Any:
        """
        Return a state with another estimate.

        Parameters
        ----------
        state : tuple
            Internal state of one arm.
        estimate : ndarray
            Estimate (k,) in SI units.

        Returns
        -------
        tuple
            Internal state.
        """
        return self._edited(state, estimate=estimate)

    def at(self, state: Any, other: Any) -> Any:
        """
        Return a state with the closed configuration of another one, near which loops are closed, and with its tank.

        Parameters
        ----------
        state, other : tuple
            Internal states of one arm.

        Returns
        -------
        tuple
            Internal state.
        """
        there = self._controller._array_of(other, ())
        return self._with(state, [(place, there[place]) for name in ("q", "tank") for place in self._places[name]])

    def _edited(self, state: Any, **values: Any) -> Any:
        return self._with(state, [(place, value) for name, value in values.items() for place in self._places[name]])

    def _with(self, state: Any, changes: Sequence[tuple[slice, Any]]) -> Any:
        if not changes:
            return state
        array = np.array(self._controller._array_of(state, ()))
        for place, value in changes:
            array[place] = value
        return self._controller._remembering(array)


def _innermost(law: Any) -> Any:
    return _innermost(law.inner) if hasattr(law, "inner") else law
