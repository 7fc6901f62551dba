"""Gravity torque of a mechanism, compiled for a loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.dynamics import Mechanism
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

    Examples
    --------
    >>> from adaptctl.hardware import GravityTorque
    >>> gravity = GravityTorque(arm)
    >>> bool(np.allclose(gravity(p), arm.inverse_dynamics(p, np.zeros(2), np.zeros(2))))
    True
    """

    def __init__(self, mechanism: Mechanism, tool: ArrayLike | None = None) -> None:
        equations, rest = mechanism.equations, Column.zeros(mechanism.dof)
        own, near = column(parameters_with(mechanism, tool)), column(mechanism.neutral_configuration)
        guess = column(mechanism.configuration(mechanism.neutral_configuration)) if equations.closure_key else near

        def torque(p: Column) -> Column:
            return equations.inverse_dynamics(equations.closed(p, guess), rest, rest, rest, own)

        self._kernel = compile_function(torque, {"p": mechanism.dof}, name="gravity torque")

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
        return np.asarray(self._kernel.call(p))


def parameters_with(mechanism: Mechanism, tool: ArrayLike | None) -> Array:
    """Parameters (P,) of a mechanism with a tool's ten added to its last link's."""
    parameters = np.array(mechanism.inertial_parameters)
    if tool is not None:
        last = 10 * (len(mechanism.description.bodies) - 1)
        parameters[last : last + 10] += np.asarray(tool)
    return parameters
