"""Natural adaptation: estimates that some rigid body has, at every tick."""

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

LONGEST_STEP = 2.0
"""The longest step of a control period in the affine-invariant metric; no moment changes more than 7.4-fold in it."""


@dataclass(frozen=True, eq=False)
class Natural(AdaptationLaw[NoMemory]):
    """Natural adaptation of the estimate (P,) of all P parameters of rigid bodies and drives (Lee, Kwon and Park 2018).

        P_i' = -rate_i P_i L_i P_i for every link's pseudo-inertia P_i, tr(L_i X) = (Y' s)_i' (the ten of X) for every X

    and the same for every drive's parameter, P_i then a number. P_i and the symmetric L_i and X are (4, 4); the ten of
    a link are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), moments and entries of the
    inertia tensor about the origin of the link's frame and along its axes; (Y' s)_i (10,) are those ten entries of Y'
    s. s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic joint), Y (r, P) the torque regressor on
    all parameters. `rate` is in 1/J: one number, or an array of one for each link with a body and then one for each
    drive's parameter. A prime is the transpose, but on P_i a derivative in time. Raises `InputError` unless `rate` is
    positive and finite, and, with a controller, for another number of rates, a model of fewer than all parameters and
    an initial estimate that is not physically consistent.

    It is the gradient in the affine-invariant metric of positive definite matrices: no gain depends on units or on
    frames. Near an estimate of mass m a rate is the gain rate m^2 on that mass, so heavy links learn faster than light
    ones.

    Guarantees, without disturbance: V = s'Ms/2 + sum_i D(P_i true, P_i)/rate_i has the time derivative -s'Ks, M the
    mass matrix and K the control law's damping, with the Bregman divergence D(A, B) = log(det B/det A) + tr(B^-1 A) - 4
    (- 1 for a drive's parameter). And whatever disturbs: every link's pseudo-inertia stays positive definite, so the
    estimate is some rigid bodies', and its mass matrix is positive definite. Sampled with the period T_c (s), P_i = G
    G' becomes G Q Q G' with G lower triangular, X = T_c rate_i G'L_i G and Q = exp(-X/2) by its Pade approximant of
    order (2, 2): the geodesic to fourth order, Q positive definite for every X. A step longer than 2 in that metric, in
    which a mass would change more than 7.4-fold within one period, ends there.

    Gives up: the reduced model; it adapts all parameters, and starts from consistent ones. Under disturbance it drifts
    like `Gradient`, and faster the farther it has come, its gain being the estimate. A body that starts with some
    moment near zero learns it slowly: 1/m moves at the rate times the mass's entry of Y' s, so a wrist of 0.05 kg that
    picks up 2 kg has 19.5 /kg to go, and one thought to hold 0.5 kg has 1.5 /kg. Start a link that may be loaded from a
    plausible load.
    """

    tunable = ("gain",)

    gain: float | Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_rate(self.gain))

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless natural adaptation fits the `model` and the initial estimate `initial` (P,), in SI
        units. Required are: a model of all P parameters of bodies and drives; linear constraints, if any, that leave
        all ten parameters of each body free; one rate, or one for each link with a body and each drive's parameter; and
        an initial estimate that is physically consistent, with positive definite pseudo-inertias and positive
        parameters of drives. `period`, the control period in s, is not used."""
        if model.basis is not None:
            raise InputError(
                f"natural adaptation: moves the pseudo-inertia of whole links, and {len(model.columns)} fundamental "
                f"parameters are none: each regroups several links' (adapt all {len(model.mechanism.parameter_names)} "
                "with ReducedModel.full(mechanism), from a consistent estimate; "
                "adaptctl.identifiability.nearest_consistent finds one with given fundamental parameters)"
            )
        validate_whole_links(model, "natural adaptation")
        validate_rates(self.gain, model)
        validate_consistent(model, initial, "natural adaptation", "the first estimate")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (P,) of all the `model`'s P parameters of bodies and drives after a control period, and the
        empty internal state. Every link's pseudo-inertia (4, 4) and every drive's parameter moves along a geodesic of
        the affine-invariant metric of positive definite matrices, the norm of a change dP at P being tr((P^-1
        dP)^2)^(1/2), against the gradient Y' s: by the law's attribute `rate` (1/J) times the integral of Y' s over the
        period (trapezium rule).

        Y' is the transpose of the torque regressor Y (r, P) at the period's start, s (r,) the sliding variable of r
        joints, rad/s (m/s if prismatic). `estimate` (P,), in the parameters' SI units and the order of
        `Mechanism.parameter_names`, and the internal state `memory` are those before the control period that `period`
        describes. Nothing is checked here.
        """
        slope = each_rate(self.gain, model) * period.gradient(period.integral)
        return moved_bodies(estimate, slope, len(model.mechanism.description.bodies)), memory

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """Sum, in J, of the Bregman divergences D(true, estimate) of all links' pseudo-inertias and drives' parameters,
        each over its adaptation rate (1/J). `estimate` (P,) has all P parameters of the `model`, `true` (P,) their true
        values, in SI units and the order of `Mechanism.parameter_names`.

        D(A, B) = log(det B/det A) + tr(B^-1 A) - 4 of pseudo-inertias A and B (4, 4), and log(B/A) + A/B - 1 of drives'
        parameters A and B. Where the estimate or the truth is not physically consistent, arrays give NaN, and floats
        raise `ValueError` or `ZeroDivisionError`.
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
        """The parameters' term (...), in J, of the adaptation law's Lyapunov function: the sum of Bregman divergences
        of pseudo-inertias and drives' parameters, each over its adaptation rate. `estimate` (..., P) has all P
        parameters of the `model`, `true`, (P,) or (..., P), their true values, in SI units and the order of
        `Mechanism.parameter_names`. Where that sum is NaN though the estimate is finite, as where the true parameters
        are no rigid bodies', it is infinity. Raises `InputError` for arrays of another shape or of no numbers."""
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.asarray(super().lyapunov_distance(model, estimate, true))
        return np.where(np.isnan(found) & np.isfinite(estimate).all(axis=-1), np.inf, found)


def checked_rate(rate: ArrayLike) -> Array:
    """A read-only float64 copy of the `rate` of natural adaptation, in 1/J: one number (), or m of them (m,), one for
    each link with a body and then one for each parameter of a drive. Raises `InputError` for more axes than one, and
    for entries that are no numbers, not positive or not finite. `validate_rates` checks that m fits a model."""
    array = numbers(rate, "natural adaptation: rate").copy()
    if array.ndim > 1 or not (np.isfinite(array).all() and np.all(array > 0.0)):
        raise InputError(f"natural adaptation: rate: expected positive numbers in 1/J, got {array.tolist()}")
    return frozen(array)


def validate_rates(rate: ArrayLike, model: ReducedModel) -> None:
    """Raise `InputError` unless the `rate` of natural adaptation, in 1/J, is one number, or an array of one for each of
    the `model`'s links with a body and then one for each drive's parameter. The values of the rates are not checked."""
    bodies, count = _bodies_and_rates(model)
    if np.shape(rate) not in ((), (count,)):
        raise InputError(
            f"natural adaptation: rate: expected a number, or {count} of them, one for each of {bodies} links and "
            f"{count - bodies} parameters of drives, got {np.size(rate)}"
        )


def validate_whole_links(model: ReducedModel, law: str) -> None:
    """Raise `InputError` where linear constraints remove some of the ten inertial parameters of a link of the `model`,
    of which its pseudo-inertia (4, 4) is made. Parameters of drives may be removed. `law` names the adaptation law in
    the message."""
    mechanism = model.mechanism
    names = mechanism.description.parameter_names[: 10 * len(mechanism.description.bodies)]
    if missing := [name for name in names if name not in mechanism.parameter_names]:
        raise InputError(
            f"{law}: moves the pseudo-inertia of whole links, and constraints of {mechanism.name} take away "
            f"{', '.join(missing)}: leave these constraints out, or take a law for parameters one by one"
        )


def validate_consistent(model: ReducedModel, parameters: Array, law: str, what: str) -> None:
    """Raise `InputError` unless `parameters` (P,), all P of the `model`'s mechanism in SI units and the order of its
    `parameter_names`, are physically consistent: the pseudo-inertia (4, 4) of each link with a body is positive
    definite, and the parameters of drives are positive. `law` and `what` name the adaptation law and the parameters in
    the message. Shapes are not checked."""
    mechanism = model.mechanism
    links = [mechanism.links[i] for i in mechanism.description.bodies]
    for i, link in enumerate(links):
        smallest = float(np.linalg.eigvalsh(pseudo_inertia(parameters[10 * i : 10 * i + 10]))[0])
        if not smallest > 0.0:
            raise InputError(
                f"{law}: no rigid body has {what} of {link.name}: its pseudo-inertia has the eigenvalue "
                f"{smallest:.3g}; start from physically consistent parameters"
            )
    for name, value in list(zip(mechanism.parameter_names, parameters.tolist(), strict=True))[10 * len(links) :]:
        if not value > 0.0:
            raise InputError(f"{law}: {what} of {name} must be positive, it is {value:g}")


def each_rate(rate: Any, model: ReducedModel) -> Column:
    """The rates (P,) of natural adaptation, in 1/J, of each of the `model`'s P parameters. `rate` is one number, or one
    for each link with a body, which its ten inertial parameters share, and then one for each drive's parameter. Raises
    `ValueError` for another number of rates."""
    bodies, count = _bodies_and_rates(model)
    rates = each(rate, count).of
    return Column((*(rate for rate in rates[:bodies] for _ in range(10)), *rates[bodies:]))


def _bodies_and_rates(model: ReducedModel) -> tuple[int, int]:
    """Number of links that have a body, and of rates: those of bodies, and those of drives' parameters."""
    bodies = len(model.mechanism.description.bodies)
    return bodies, len(model.mechanism.parameter_names) - 9 * bodies


def moved_bodies(parameters: Column, slope: Column, bodies: int) -> Column:
    """All P parameters (P,) of bodies and drives, in SI units, after one step of natural adaptation from `parameters`
    (P,). The first 10 `bodies` of them are the ten inertial parameters of each of `bodies` links, which move along the
    geodesic of the link's pseudo-inertia; the drives' parameters, which come after them, move along that of a positive
    number.

    `slope` (P,), in the parameters' inverse units, is each one's rate in 1/J times the integral over the period of the
    gradient Y' s, in J per unit, Y' being the transpose of the torque regressor Y and s the sliding variable. Nothing
    is checked: parameters that no rigid bodies have raise `ValueError` or `ZeroDivisionError` in floats, and give NaN
    in arrays.
    """
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
    """The natural gradient (P,) of all P parameters of bodies and drives, in their SI units, of a `slope` (P,) in the
    inverse units, at `parameters` (P,). For each of `bodies` links, which come first, it has the ten inertial
    parameters of P_i L_i P_i, with the link's pseudo-inertia P_i (4, 4) and the slope's symmetric matrix L_i (4, 4);
    for each drive's parameter x, which come after them, x^2 times its slope. A step of natural adaptation begins along
    minus this gradient. Nothing is checked."""
    links = 10 * bodies
    entries: list[Any] = []
    for i in range(0, links, 10):
        P = pseudo(parameters.of[i : i + 10])
        entries += the_ten(matrix_product(P, matrix_product(slope_matrix(slope.of[i : i + 10]), P)))
    entries += [x * x * g for x, g in zip(parameters.of[links:], slope.of[links:], strict=True)]
    return Column(entries)


def moved_body(ten: Sequence[Scalar], slope: Sequence[Scalar]) -> list[Any]:
    """A link's ten inertial parameters after one step of natural adaptation from `ten`, along the geodesic of its
    pseudo-inertia: a list of m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz in kg, kg m and kg m^2. `slope`
    (10,), in the inverse units, is the rate times the integral of the gradient over the period.

    With the pseudo-inertia G G', G lower triangular and G' its transpose, the step goes to G Q Q G', Q positive
    definite. The difference from G G' is computed by itself and added to `ten`, so that many small steps do not add up
    round-off. A `ten` that no rigid body has raises `ValueError` or `ZeroDivisionError` in floats, and gives NaN in
    arrays.
    """
    root = cholesky(pseudo(ten))
    X = matrix_product(transposed(root), matrix_product(slope_matrix(slope), root))
    less = _decay_less_one(X)
    change = [
        [2.0 * d + e for d, e in zip(*rows, strict=True)] for rows in zip(less, matrix_product(less, less), strict=True)
    ]
    added = matrix_product(root, matrix_product(change, transposed(root)))
    return [old + new for old, new in zip(ten, the_ten(added), strict=True)]


def _decay_less_one(X: Matrix) -> Matrix:
    """exp(-X/2) - 1 of a symmetric X: -Y (1 + Y/2 + Y^2/12)^-1 for Y = X/2, the last factor positive; a longer X is
    taken as one of length `LONGEST_STEP`."""
    square = matrix_product(X, X)
    share = LONGEST_STEP / maximum(sqrt(square[0][0] + square[1][1] + square[2][2] + square[3][3]), LONGEST_STEP)
    Y, squares = 0.5 * share, share * share / 48.0
    below = [[float(i == j) + 0.5 * Y * X[i][j] + squares * square[i][j] for j in range(4)] for i in range(4)]
    columns = [solve_symmetric(below, Column([-Y * x for x in row])).of for row in X]
    return transposed([list(entries) for entries in columns])


def pseudo(ten: Sequence[Scalar]) -> Matrix:
    """The pseudo-inertia (4, 4), as rows of scalars, of a link's `ten` inertial parameters: the integral over its mass
    of x x', x = (position in metres, 1) in the link's frame and x' its transpose. `ten` are m, mc_x, mc_y, mc_z, I_xx,
    I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), the I_.. being the inertia tensor's entries about that frame's
    origin, I_xy = -integral of x y dm. Raises `ValueError` for another number of them."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    half = 0.5 * (xx + yy + zz)
    return [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]


def the_ten(P: Matrix) -> list[Any]:
    """The ten inertial parameters of a pseudo-inertia `P` (4, 4), given by rows, of which the upper triangle is read: a
    list of m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz in kg, kg m and kg m^2. The inertia tensor is about
    the frame's origin, I_xy = -integral of x y dm. Raises `ValueError` for another shape."""
    (xx, xy, xz, x), (_, yy, yz, y), (_, _, zz, z), (_, _, _, m) = P
    return [m, x, y, z, yy + zz, -xy, xx + zz, -xz, -yz, xx + yy]


def slope_matrix(slope: Sequence[Scalar]) -> Matrix:
    """The symmetric matrix L (4, 4), as rows of scalars, of a `slope` (10,), such that tr(L P) is the inner product of
    the slope and the ten inertial parameters of P for every pseudo-inertia P (4, 4). The slope is per unit of m, mc_x,
    mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), in this order. Raises `ValueError` for another
    number of entries."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = (0.5 * g for g in slope)
    row = (2.0 * (yy + zz), -xy, -xz, x), (2.0 * (xx + zz), -yz, y), (2.0 * (xx + yy), z), (2.0 * m,)
    return [[row[min(i, j)][max(i, j) - min(i, j)] for j in range(4)] for i in range(4)]


def cholesky(P: Matrix) -> Matrix:
    """The lower triangular Cholesky factor G (n, n), as rows of scalars of any kind, of a symmetric positive definite
    matrix `P` (n, n) of any size n, given by rows. G G' = P, G' being the transpose of G. A matrix that is not positive
    definite raises `ValueError` or `ZeroDivisionError` in floats, and gives NaN or infinity in arrays."""
    G: Matrix = [[0.0] * len(P) for _ in P]
    for j in range(len(P)):
        for i in range(j, len(P)):
            rest = P[i][j] - sum((G[i][k] * G[j][k] for k in range(j)), 0.0)
            G[i][j] = sqrt(rest) if i == j else rest / G[j][j]
    return G


def matrix_product(A: Matrix, B: Matrix) -> Matrix:
    """The product A B (l, n) of matrices A (l, m) and B (m, n), of any sizes, as rows of scalars of any kind. Raises
    `ValueError` where A has not as many columns as B has rows."""
    return [
        [sum((a * b for a, b in zip(row, column, strict=True)), 0.0) for column in zip(*B, strict=True)] for row in A
    ]


def transposed(A: Matrix) -> Matrix:
    """The transpose (n, m) of a matrix A (m, n) of any size, as rows of scalars of any kind. Raises `ValueError` for
    rows of different lengths."""
    return [list(column) for column in zip(*A, strict=True)]


def pseudos(tens: Array) -> Array:
    """The pseudo-inertias (..., 4, 4) of bodies with the inertial parameters `tens` (..., 10), each in the axes of its
    link's frame. The ten are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), about that
    frame's origin, I_xy = -integral of x y dm. Raises `ValueError` for another number of them."""
    rows = pseudo(list(np.moveaxis(tens, -1, 0)))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def divergence(true: Matrix, estimate: Matrix) -> Scalar:
    """The log-det divergence log(det estimate / det true) + tr(estimate^-1 true) - 4, without a unit, of two
    pseudo-inertias (4, 4), `true` and `estimate`, given by rows of scalars of any kind. It is 0 where they are equal,
    else positive. Where one is not positive definite, arrays give NaN, and floats raise `ValueError` or
    `ZeroDivisionError`."""
    shares = (solve_symmetric([list(row) for row in estimate], Column(column)) for column in transposed(true))
    trace: Scalar = sum((share[i] for i, share in enumerate(shares)), 0.0)
    return trace - 4.0 + 2.0 * (_log_root(estimate) - _log_root(true))


def _log_root(P: Matrix) -> Scalar:
    """Half of log det P."""
    root = cholesky(P)
    return sum((log(root[i][i]) for i in range(len(P))), 0.0)
