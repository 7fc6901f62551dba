"""Gravity torque of a mechanism, compiled for a loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loops.continuation import MAX_PRIMARY_STEP
from adaptctl.scalars import Column, column


class GravityTorque:
    """
    Torque that holds a mechanism at rest.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints, with its own parameters.
    tool : array_like, optional
        Ten inertial parameters (10,) in SI units, in the last link's frame, of what it holds. Default: nothing.

    Notes
    -----
    Loops are closed near those of the call before, and from the reference configuration at first: give postures along a
    motion. Raises `SingularityError` for a jump across a singularity of the loops.

    Examples
    --------
    >>> from adaptctl.hardware import GravityTorque
    >>> gravity = GravityTorque(arm)
    >>> bool(np.allclose(gravity(p), arm.inverse_dynamics(p, np.zeros(2), np.zeros(2))))
    True
    """

    def __init__(self, mechanism: Mechanism, tool: ArrayLike | None = None) -> None:
        equations, rest = mechanism.equations, Column.zeros(mechanism.dof)
        own = column(parameters_with(mechanism, tool))

        def torque(p: Column, near: Column) -> tuple[Column, Column]:
            q = equations.closed(p, near)
            return equations.inverse_dynamics(q, rest, rest, rest, own), q

        sizes = {"p": mechanism.dof, "near": len(mechanism.links)}
        self._kernel = compile_function(torque, sizes, name="gravity torque")
        self._mechanism, self._loops = mechanism, mechanism.continuation
        self._last = mechanism.configuration(mechanism.neutral_configuration)

    def __call__(self, p: Array) -> Array:
        """
        Return the torque at a posture.

        Parameters
        ----------
        p : ndarray
            Positions (r,) in rad (m).

        Returns
        -------
        ndarray
            Torque (r,) in N m (N).
        """
        torque, self._last = self._kernel.call(p, self._near(p))
        return np.asarray(torque)

    def _near(self, p: Array) -> Array:
        """Closed configuration (n,) from which loops are closed at p (r,)."""
        if self._loops is None or (np.abs(p - self._last[self._loops.primary]) <= MAX_PRIMARY_STEP).all():
            return self._last
        return self._mechanism.configuration(p, self._last)


def parameters_with(mechanism: Mechanism, tool: ArrayLike | None) -> Array:
    """Parameters (P,) of a mechanism with a tool's ten added to its last link's."""
    parameters = np.array(mechanism.inertial_parameters)
    if tool is not None:
        last = 10 * (len(mechanism.description.bodies) - 1)
        parameters[last : last + 10] += np.asarray(tool)
    return parameters
