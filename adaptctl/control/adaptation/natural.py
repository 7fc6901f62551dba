"""Natural adaptation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, numbers
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each, log, maximum, sqrt

Matrix: TypeAlias = list[list[Any]]
"""Rows of a small matrix of scalars."""

MAX_STEP = 2.0  # in the affine-invariant metric: no moment changes more than 7.4-fold in a period


@dataclass(frozen=True, eq=False)
class Natural(AdaptationLaw[NoMemory]):
    r"""
    Adaptation of all parameters along geodesics, which keeps every body physically consistent.

    Parameters
    ----------
    gain : array_like
        Rate of adaptation in 1/J, one number, or one for each link with inertia and then one for each drive parameter.

    Raises
    ------
    InputError
        If a rate is not positive, or, with a controller, the model has fewer than all parameters or the initial
        estimate is not consistent.

    Notes
    -----
    Every pseudo-inertia P follows the gradient :math:`\dot P=-\gamma PLP` in the affine-invariant metric, L its part of
    :math:`Y^\top s`, and stays positive definite [1]_. The gain on a mass grows with its square: start links from a
    plausible load.

    References
    ----------
    .. [1] Lee, Kwon and Park, IROS, 2018.

    Examples
    --------
    >>> from adaptctl.control import Natural
    >>> full = adaptctl.ReducedModel.full(arm)
    >>> first = np.tile([2.0, -0.2, 0.0, 0.0, 0.1, 0.0, 0.2, 0.0, 0.0, 0.2], 2)
    >>> adaptctl.SlotineLi(full, 5.0, 4.0, Natural(gain=0.1), initial=first).dof
    2
    """

    tunable = ("gain",)

    gain: float | Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_rate(self.gain))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if the law does not fit the model and the initial estimate.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        initial : ndarray
            Initial estimate (k,) in SI units.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If the model has fewer than all parameters, a size does not fit, or the initial estimate is not consistent.
        """
        if model.basis is not None:
            raise InputError(
                f"natural adaptation: adapts the pseudo-inertia of whole links, which {len(model.columns)} base "
                "parameters do not have, because they regroup several links (adapt all "
                f"{len(model.mechanism.parameter_names)} "
                "with ReducedModel.full(mechanism), from a consistent estimate; "
                "adaptctl.identifiability.nearest_consistent finds one with given base parameters)"
            )
        validate_whole_links(model, "natural adaptation")
        validate_rates(self.gain, model)
        validate_consistent(model, initial, "natural adaptation", "the initial estimate")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """
        Update pseudo-inertias and drive parameters along geodesics.

        Parameters
        ----------
        model : ReducedModel
            Model with all P parameters of the mechanism.
        estimate : Column
            Estimate (P,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : NoMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and NoMemory
            Estimate (P,) in SI units and internal state after the period.
        """
        slope = each_rate(self.gain, model) * period.gradient(period.integral)
        return moved_bodies(estimate, slope, len(model.mechanism.description.bodies)), memory

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """
        Compute the sum of Bregman divergences of all bodies, NaN for inconsistent parameters.

        Parameters
        ----------
        model : ReducedModel
            Model with all P parameters of the mechanism.
        estimate, true : Column
            Estimate and true values (P,) in SI units.

        Returns
        -------
        scalar or None
            Energy in J, or None if it depends on more than the estimate, such as a covariance.
        """
        rates, bodies = each_rate(self.gain, model), 10 * len(model.mechanism.description.bodies)
        total: Scalar = 0.0
        for i in range(0, bodies, 10):
            total = total + divergence(pseudo(true.of[i : i + 10]), pseudo(estimate.of[i : i + 10])) / rates[i]
        for k in range(bodies, len(estimate)):
            ratio = true[k] / estimate[k]
            total = total + (ratio - log(ratio) - 1.0) / rates[k]
        return total

    def lyapunov_distance(self, model: ReducedModel, estimate: Array, true: Array) -> Array:
        """
        Compute the sum of Bregman divergences of all bodies, infinite for inconsistent parameters.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : ndarray
            Estimates (..., k) in SI units.
        true : ndarray
            True values (k,) or (..., k) in SI units.

        Returns
        -------
        ndarray or None
            Energies (...) in J, or None if they depend on more than the estimate, such as a covariance.

        Raises
        ------
        InputError
            If a shape is wrong.

        Examples
        --------
        >>> natural = adaptctl.control.Natural(1.0)
        >>> full = adaptctl.ReducedModel.full(arm)
        >>> true = full.fundamental_parameters
        >>> round(float(natural.lyapunov_distance(full, true, true)), 6)
        0.0
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.asarray(super().lyapunov_distance(model, estimate, true))
        return np.where(np.isnan(found) & np.isfinite(estimate).all(axis=-1), np.inf, found)


def checked_rate(rate: ArrayLike) -> Array:
    """Read-only positive rate, () or (m,), else `InputError`."""
    array = numbers(rate, "natural adaptation: gain").copy()
    if array.ndim > 1 or not (np.isfinite(array).all() and np.all(array > 0.0)):
        raise InputError(f"natural adaptation: gain: expected positive numbers in 1/J, got {array.tolist()}")
    return frozen(array)


def validate_rates(rate: ArrayLike, model: ReducedModel) -> None:
    """Raise `InputError` for another number of rates."""
    bodies, count = _bodies_and_rates(model)
    if np.shape(rate) not in ((), (count,)):
        raise InputError(
            f"natural adaptation: gain: expected a number, or {count} of them, one for each of {bodies} links and "
            f"{count - bodies} parameters of drives, got {np.size(rate)}"
        )


def validate_whole_links(model: ReducedModel, law: str) -> None:
    """Raise `InputError` if constraints remove parameters of a body."""
    mechanism = model.mechanism
    names = mechanism.description.parameter_names[: 10 * len(mechanism.description.bodies)]
    if missing := [name for name in names if name not in mechanism.parameter_names]:
        raise InputError(
            f"{law}: adapts the pseudo-inertia of whole links, but constraints of {mechanism.name} remove "
            f"{', '.join(missing)}: remove these constraints, or use a law for single parameters"
        )


def validate_consistent(model: ReducedModel, parameters: Array, law: str, what: str) -> None:
    """Raise `InputError` unless physically consistent."""
    mechanism = model.mechanism
    links = [mechanism.links[i] for i in mechanism.description.bodies]
    for i, link in enumerate(links):
        smallest = float(np.linalg.eigvalsh(pseudo_inertia(parameters[10 * i : 10 * i + 10]))[0])
        if not smallest > 0.0:
            raise InputError(
                f"{law}: {what} of {link.name} is not physically consistent: its pseudo-inertia has the eigenvalue "
                f"{smallest:.3g}; start from physically consistent parameters"
            )
    for name, value in list(zip(mechanism.parameter_names, parameters.tolist(), strict=True))[10 * len(links) :]:
        if not value > 0.0:
            raise InputError(f"{law}: {what} of {name} must be positive, it is {value:g}")


def each_rate(rate: Any, model: ReducedModel) -> Column:
    """Rates (P,) of all parameters."""
    bodies, count = _bodies_and_rates(model)
    rates = each(rate, count).of
    return Column((*(rate for rate in rates[:bodies] for _ in range(10)), *rates[bodies:]))


def _bodies_and_rates(model: ReducedModel) -> tuple[int, int]:
    bodies = len(model.mechanism.description.bodies)
    return bodies, len(model.mechanism.parameter_names) - 9 * bodies


def moved_bodies(parameters: Column, slope: Column, bodies: int) -> Column:
    """Parameters (P,) after one step."""
    links = 10 * bodies
    entries: list[Any] = []
    for i in range(0, links, 10):
        entries += moved_body(parameters.of[i : i + 10], slope.of[i : i + 10])
    for x, g in zip(parameters.of[links:], slope.of[links:], strict=True):
        half = 0.25 * (x * g)
        even = 1.0 + half * half / 3.0
        factor = (even - half) / (even + half)
        entries.append(x * factor * factor)
    return Column(entries)


def raised_slope(parameters: Column, slope: Column, bodies: int) -> Column:
    """Natural gradient (P,) of a slope."""
    links = 10 * bodies
    entries: list[Any] = []
    for i in range(0, links, 10):
        P = pseudo(parameters.of[i : i + 10])
        entries += the_ten(matrix_product(P, matrix_product(slope_matrix(slope.of[i : i + 10]), P)))
    entries += [x * x * g for x, g in zip(parameters.of[links:], slope.of[links:], strict=True)]
    return Column(entries)


def moved_body(ten: Sequence[Scalar], slope: Sequence[Scalar]) -> list[Any]:
    """Ten parameters after one step, by their change against round-off."""
    root = cholesky(pseudo(ten))
    X = matrix_product(transposed(root), matrix_product(slope_matrix(slope), root))
    less = _decay_less_one(X)
    change = [
        [2.0 * d + e for d, e in zip(*rows, strict=True)] for rows in zip(less, matrix_product(less, less), strict=True)
    ]
    added = matrix_product(root, matrix_product(change, transposed(root)))
    return [old + new for old, new in zip(ten, the_ten(added), strict=True)]


def _decay_less_one(X: Matrix) -> Matrix:
    """exp(-X/2) - 1 by a Pade approximant."""
    square = matrix_product(X, X)
    share = MAX_STEP / maximum(sqrt(square[0][0] + square[1][1] + square[2][2] + square[3][3]), MAX_STEP)
    Y, squares = 0.5 * share, share * share / 48.0
    below = [[float(i == j) + 0.5 * Y * X[i][j] + squares * square[i][j] for j in range(4)] for i in range(4)]
    columns = [solve_symmetric(below, Column([-Y * x for x in row])).of for row in X]
    return transposed([list(entries) for entries in columns])


def pseudo(ten: Sequence[Scalar]) -> Matrix:
    """Pseudo-inertia (4, 4) of ten parameters."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    half = 0.5 * (xx + yy + zz)
    return [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]


def the_ten(P: Matrix) -> list[Any]:
    """Ten parameters of a pseudo-inertia."""
    (xx, xy, xz, x), (_, yy, yz, y), (_, _, zz, z), (_, _, _, m) = P
    return [m, x, y, z, yy + zz, -xy, xx + zz, -xz, -yz, xx + yy]


def slope_matrix(slope: Sequence[Scalar]) -> Matrix:
    """Symmetric L (4, 4) with tr(L P) = slope' (ten of P)."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = (0.5 * g for g in slope)
    row = (2.0 * (yy + zz), -xy, -xz, x), (2.0 * (xx + zz), -yz, y), (2.0 * (xx + yy), z), (2.0 * m,)
    return [[row[min(i, j)][max(i, j) - min(i, j)] for j in range(4)] for i in range(4)]


def cholesky(P: Matrix) -> Matrix:
    """Lower Cholesky factor."""
    G: Matrix = [[0.0] * len(P) for _ in P]
    for j in range(len(P)):
        for i in range(j, len(P)):
            rest = P[i][j] - sum((G[i][k] * G[j][k] for k in range(j)), 0.0)
            G[i][j] = sqrt(rest) if i == j else rest / G[j][j]
    return G


def matrix_product(A: Matrix, B: Matrix) -> Matrix:
    """Product of two matrices."""
    return [
        [sum((a * b for a, b in zip(row, column, strict=True)), 0.0) for column in zip(*B, strict=True)] for row in A
    ]


def transposed(A: Matrix) -> Matrix:
    """Transpose of a matrix."""
    return [list(column) for column in zip(*A, strict=True)]


def pseudos(tens: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) of (..., 10)."""
    rows = pseudo(list(np.moveaxis(tens, -1, 0)))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def divergence(true: Matrix, estimate: Matrix) -> Scalar:
    """Log-det divergence of two pseudo-inertias."""
    shares = (solve_symmetric([list(row) for row in estimate], Column(column)) for column in transposed(true))
    trace: Scalar = sum((share[i] for i, share in enumerate(shares)), 0.0)
    return trace - 4.0 + 2.0 * (_log_root(estimate) - _log_root(true))


def _log_root(P: Matrix) -> Scalar:
    root = cholesky(P)
    return sum((log(root[i][i]) for i in range(len(P))), 0.0)
