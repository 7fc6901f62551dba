"""Physically consistent bodies, by as many coordinates as there are base parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked
from adaptctl.description.inertia import TEN_OF_PSEUDO_INERTIA, UNIT_PSEUDO_INERTIAS
from adaptctl.errors import InputError, validate_kind
from adaptctl.identifiability.fundamental_basis import FundamentalBasis

# Share of the multipliers in the coordinates: those that no bodies have still have a solution.
SLACK = 0.1
MOST_STEPS, ROUNDOFF, FARTHEST = 100, 1e-15, 1e4


@dataclass(frozen=True, eq=False)
class ConsistentBodies:
    """
    Physically consistent bodies, by as many coordinates as there are base parameters.

    Made by `of`. Any k numbers are coordinates of consistent bodies, and all base parameters that consistent bodies can
    have belong to exactly one point: an optimiser needs no constraint and no projection. Coordinates are nearly affine
    in the base parameters, in units in which 1 changes the bodies by about all of them; the start is at 0.

    Parameters
    ----------
    basis : FundamentalBasis
        Basis of a mechanism, k base parameters of N links.
    roots : numpy.ndarray
        Cholesky factors (N, 4, 4) of the links' pseudo-inertias at the start.
    directions : numpy.ndarray
        Symmetric matrices (k, N, 4, 4), orthonormal, of which the coordinates are the factors.

    Notes
    -----
    With pseudo-inertias L_i L_i' at the start (Wensing, Kim and Slotine 2018), those at z are L_i E_i L_i', where
    E_i = X_i + (1 + X_i^2)^(1/2) and X_i = sum x_j D_ji. The D_j span what the base parameters are functionals of, so
    that E_i - 1/E_i = 2 X_i is the condition of the least sum of tr(E_i^2)/2 - log det E_i at given base parameters.
    That function is of Legendre's type (Rockafellar 1970, section 26), hence one x for each base vector. The base
    parameters in those units are y_j = sum <D_ji, E_i - 1>, and z = y + x/10, which has a solution everywhere.

    Examples
    --------
    >>> import adaptctl
    >>> from adaptctl.identifiability import ConsistentBodies
    >>> arm = adaptctl.load("two_link")
    >>> basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    >>> bodies = ConsistentBodies.of(basis, [link.inertia for link in arm.links])
    >>> bool(bodies.at([0.0] * bodies.size)[0, 0] == arm.links[0].inertia[0])
    True
    >>> bodies.at([-9.0] * bodies.size)[:, 0] > 0.0  # masses
    array([ True,  True])
    """

    basis: FundamentalBasis
    roots: Array
    directions: Array

    @classmethod
    def of(cls, basis: FundamentalBasis, start: ArrayLike) -> ConsistentBodies:
        """
        Return the bodies about a start.

        Parameters
        ----------
        basis : FundamentalBasis
            Basis of a mechanism without rotor inertias, k base parameters of N links.
        start : array_like
            Ten inertial parameters (N, 10) of each link in SI units.

        Returns
        -------
        ConsistentBodies
            Bodies of which `start` is at 0.

        Raises
        ------
        InputError
            If the basis has other parameters than those of N links, or a link of the start is not consistent.
        """
        validate_kind(basis, FundamentalBasis, "basis", "as fundamental_basis(essential_space(mechanism)) is one")
        tens = np.atleast_2d(checked(start, 10, "start"))
        k, columns = basis.regrouping.shape
        if columns % 10:
            raise InputError("basis: expected that of links alone; take rotor inertias off: with_drives(Drive())")
        if tens.shape != (columns // 10, 10):
            raise InputError(f"start: expected shape ({columns // 10}, 10) for this basis, got {tens.shape}")
        matrices = np.einsum("na,aij->nij", tens, UNIT_PSEUDO_INERTIAS)
        bad = np.flatnonzero(~(np.linalg.eigvalsh(matrices)[:, 0] > 0.0))
        if bad.size:
            raise InputError(f"start: link {bad[0]} of {len(tens)} is not physically consistent; give rough values")
        roots = np.linalg.cholesky(matrices)
        functionals = np.einsum(
            "kna,ija->knij", basis.regrouping.reshape(k, -1, 10), TEN_OF_PSEUDO_INERTIA.reshape(4, 4, 10)
        )
        relative = roots.mT @ functionals @ roots
        return cls(basis, roots, _orthonormal(relative.reshape(k, -1)).reshape(relative.shape))

    @property
    def size(self) -> int:
        """Number k of coordinates."""
        return len(self.directions)

    def at(self, coordinates: ArrayLike) -> Array:
        """
        Return the bodies at coordinates.

        Parameters
        ----------
        coordinates : array_like
            Coordinates (k,), of which 1 changes bodies by about all of them.

        Returns
        -------
        numpy.ndarray
            Ten inertial parameters (N, 10) of each link in SI units, physically consistent.

        Raises
        ------
        InputError
            If the coordinates are not k numbers from -1e4 to 1e4, beyond which round-off decides.
        """
        z = checked(coordinates, self.size, "coordinates")
        if np.abs(z).max() > FARTHEST:
            raise InputError(f"coordinates: expected at most {FARTHEST:g}, got {np.abs(z).max():g}")
        change = _Change.of(self._multipliers(z), self.directions)
        return np.asarray((self.roots @ change.matrices @ self.roots.mT).reshape(-1, 16) @ TEN_OF_PSEUDO_INERTIA)

    def base_parameters(self, coordinates: ArrayLike) -> Array:
        """
        Return the base parameters of the bodies at coordinates.

        Parameters
        ----------
        coordinates : array_like
            Coordinates (k,).

        Returns
        -------
        numpy.ndarray
            Base parameters (k,) in SI units, of `basis.names`.

        Raises
        ------
        InputError
            If the coordinates are not k finite numbers.
        """
        return np.asarray(self.basis.regrouping @ self.at(coordinates).ravel())

    def _multipliers(self, z: Array) -> Array:
        """The x (k,) of coordinates, by Newton's method with halved steps; its equation is monotone."""
        x: Array = np.zeros(self.size)
        step = x.copy()
        best = np.inf
        for _ in range(MOST_STEPS):
            change = _Change.of(x + step, self.directions)
            rest = z - change.sums - SLACK * (x + step)
            size = float(np.linalg.norm(rest))
            if size < best:
                x, best = x + step, size
                step = np.asarray(np.linalg.solve(change.slopes + SLACK * np.eye(self.size), rest))
            else:
                step = 0.5 * step
            if np.linalg.norm(step) <= ROUNDOFF * (1.0 + np.linalg.norm(x)):
                break
        return x


@dataclass(frozen=True, eq=False)
class _Change:
    """Matrices E of multipliers x."""

    values: Array
    axes: Array
    turned: Array

    @classmethod
    def of(cls, x: Array, directions: Array) -> _Change:
        values, axes = np.linalg.eigh(np.tensordot(x, directions, 1))
        return cls(values, axes, axes.mT @ directions @ axes)

    @property
    def stretches(self) -> Array:
        """Eigenvalues (N, 4) of E, x + sqrt(1 + x^2) without its cancellation where x is negative."""
        return np.exp(np.arcsinh(self.values))

    @property
    def matrices(self) -> Array:
        """E (N, 4, 4)."""
        return (self.axes * self.stretches[:, None, :]) @ self.axes.mT

    @property
    def sums(self) -> Array:
        """y (k,), the sums of <D, E - 1>."""
        return np.einsum("knaa,na->k", self.turned, self.stretches - 1.0)

    @property
    def slopes(self) -> Array:
        """Derivatives (k, k) of y by x, by divided differences of the eigenvalues."""
        h, s = self.stretches, np.sqrt(1.0 + self.values**2)
        ratios = (h[:, :, None] + h[:, None, :]) / (s[:, :, None] + s[:, None, :])
        k = len(self.turned)
        return (self.turned * ratios).reshape(k, -1) @ self.turned.reshape(k, -1).T


def _orthonormal(rows: Array) -> Array:
    """Orthonormal rows of the same span, each the nearest to the given one of its direction."""
    left, _, right = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True), full_matrices=False)
    return np.asarray(left @ right)
