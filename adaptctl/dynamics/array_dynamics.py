"""Energies, torques, accelerations and regressors of a mechanism on NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, finite_results, same_samples
from adaptctl.dynamics.mechanism_structure import MechanismStructure
from adaptctl.dynamics.parameter_layout import required_columns

if TYPE_CHECKING:
    from adaptctl.dynamics.array_equations import OnArrays


class ArrayDynamics(MechanismStructure):
    """Energies, torques, accelerations and regressors of a `Mechanism` on NumPy arrays."""

    def column_regressor(self, regressor: str, columns: Sequence[int]) -> OnArrays:
        """
        Return a function that computes only some columns of a regressor.

        Parameters
        ----------
        regressor : str
            Name of the method, "torque_regressor" or "slotine_li_regressor".
        columns : sequence of int
            Indices, from 0 to P - 1, of the k parameters.

        Returns
        -------
        ArrayEquation
            Its method `call` takes the arguments of that regressor and returns the columns (..., r, k) in N m (N) per
            unit of each parameter.

        Raises
        ------
        InputError
            If the name is unknown or an index out of range.

        Examples
        --------
        >>> arm.column_regressor("torque_regressor", [0, 5, 9]).call(p, v, v).shape
        (2, 3)
        """
        asked = required_columns(columns, len(self.parameter_names), self.name)
        return self._arrays.on_columns(regressor, tuple(asked))

    def energy_regressor(self, p: ArrayLike, v: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the regressor of the energy.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        out : ndarray, optional
            Array (..., P) of float64 to fill in J per unit of each parameter. Default: a new one; a given one saves its
            allocation.

        Returns
        -------
        ndarray
            Regressor E (..., P) in J per unit of each parameter.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Notes
        -----
        :math:`E D = T + U` for parameters D, with kinetic energy T and potential energy U, zero at the ground frame's
        origin (Sheu and Walker 1991, section 2.2).

        Examples
        --------
        >>> bool(np.allclose(arm.energy_regressor(p, v) @ arm.inertial_parameters, arm.energy(p, v)))
        True
        """
        if out is None:
            return self._arrays.energy_regressor.call(p, v)
        return self._arrays.energy_regressor.into(out, p, v)

    @finite_results
    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """
        Compute the kinetic plus potential energy.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).

        Returns
        -------
        ndarray
            Energy (...) in J; its potential part is zero at the ground frame's origin.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> arm.energy(np.zeros((5, 2)), np.zeros((5, 2))).shape
        (5,)
        """
        return self.energy_regressor(p, v) @ self.inertial_parameters

    def torque_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        r"""
        Compute the regressor of the torque, which is linear in the parameters.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).
        columns : sequence of int, optional
            Indices of the k parameters; all P by default.
        out : ndarray, optional
            Array of float64 to fill, of the result's shape; a new one by default.

        Returns
        -------
        ndarray
            Regressor Y (..., r, P), or (..., r, k), in N m (N) per unit of each parameter.

        Raises
        ------
        InputError
            If a shape or an index is wrong.

        Notes
        -----
        :math:`Y(p, v, a) D = \tau` for parameters D, gravity and friction included.

        Examples
        --------
        >>> Y = arm.torque_regressor(p, v, [0.0, 1.0])
        >>> bool(np.allclose(Y @ arm.inertial_parameters, arm.inverse_dynamics(p, v, [0.0, 1.0])))
        True
        """
        own = self._arrays.torque_regressor
        equation = own if columns is None else self.column_regressor("torque_regressor", columns)
        return equation.call(p, v, a) if out is None else equation.into(out, p, v, a)

    def slotine_li_regressor(
        self,
        p: ArrayLike,
        v: ArrayLike,
        v_r: ArrayLike,
        a_r: ArrayLike,
        columns: Sequence[int] | None = None,
        out: Array | None = None,
    ) -> Array:
        r"""
        Compute the regressor of Slotine and Li's adaptive law.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        v_r, a_r : array_like
            Reference velocities and accelerations (..., r) in rad/s and rad/s^2 (m/s and m/s^2).
        columns : sequence of int, optional
            Indices of the k parameters; all P by default.
        out : ndarray, optional
            Array of float64 to fill, of the result's shape; a new one by default.

        Returns
        -------
        ndarray
            Regressor Y_r (..., r, P), or (..., r, k), in N m (N) per unit of each parameter.

        Raises
        ------
        InputError
            If a shape or an index is wrong.

        Notes
        -----
        .. math:: Y_r D = M(p)\, a_r + C(p, v)\, v_r + g(p) + f(v_r)

        with parameters D, mass matrix M, Coriolis matrix C by Christoffel symbols, gravity g and friction f.

        Examples
        --------
        >>> arm.slotine_li_regressor(p, v, v, [0.0, 0.0], columns=[0, 1, 9]).shape
        (2, 3)
        """
        own = self._arrays.slotine_li_regressor
        equation = own if columns is None else self.column_regressor("slotine_li_regressor", columns)
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the torque that gives an acceleration, against inertia, gravity and friction.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).
        out : ndarray, optional
            Array (..., r) of float64 to fill in N m (N). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Torque (..., r) in N m (N if prismatic).

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> torque = arm.inverse_dynamics(p, v, [1.0, 2.0])
        >>> bool(np.allclose(arm.forward_dynamics(p, v, torque), [1.0, 2.0]))
        True
        """
        if out is None:
            return self._arrays.inverse_dynamics.call(p, v, a, self.inertial_parameters)
        return self._arrays.inverse_dynamics.into(out, p, v, a, self.inertial_parameters)

    def constraint_bias_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """
        Compute the torque due to the parameter values that linear constraints fix.

        Parameters
        ----------
        p, v, a : array_like
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).

        Returns
        -------
        ndarray
            Torque (..., r) in N m (N if prismatic), which regressors leave out; zero without constraints.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> arm.constraint_bias_torque(p, v, v).tolist()
        [0.0, 0.0]
        """
        given = {"p": p, "v": v, "a": a}
        samples = same_samples(**{what: checked(x, self.dof, f"{self.name}: {what}") for what, x in given.items()})
        return np.zeros((*samples, self.dof))

    def forward_dynamics(self, p: ArrayLike, v: ArrayLike, torque: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the acceleration under a torque, gravity and friction.

        Parameters
        ----------
        p, v : array_like
            Positions and velocities (..., r) in rad and rad/s (m and m/s if prismatic).
        torque : array_like
            Torque (..., r) in N m (N if prismatic).
        out : ndarray, optional
            Array (..., r) of float64 to fill in rad/s^2 (m/s^2). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Accelerations (..., r) in rad/s^2 (m/s^2).

        Raises
        ------
        InputError
            If a shape is wrong, or if end links of a tree have neither mass nor rotor.

        Examples
        --------
        >>> arm.forward_dynamics(p, v, [5.0, 1.0]).shape
        (2,)
        """
        if out is None:
            return self._arrays.forward_dynamics.call(p, v, torque, self.inertial_parameters)
        return self._arrays.forward_dynamics.into(out, p, v, torque, self.inertial_parameters)

    def mass_matrix(self, p: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the symmetric mass matrix, with rotor inertias.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad (m if prismatic).
        out : ndarray, optional
            Array (..., r, r) of float64 to fill in kg m^2 (kg). Default: a new one; a given one saves its allocation.

        Returns
        -------
        ndarray
            Mass matrix (..., r, r) in kg m^2 (kg between prismatic joints, kg m between different ones).

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is not finite.

        Examples
        --------
        >>> M = arm.mass_matrix(p)
        >>> bool(np.all(np.linalg.eigvalsh(M) > 0.0))
        True
        """
        if out is None:
            return self._arrays.mass_matrix.call(p, self.inertial_parameters)
        return self._arrays.mass_matrix.into(out, p, self.inertial_parameters)
