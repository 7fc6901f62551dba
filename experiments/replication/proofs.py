"""Numbers that prove where the paper is wrong: rounded right angles, null combinations, rounding, and decoupling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import linprog

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication.arms import SampledArm, index, parameters, sign
from adaptctl.experiments.replication.printed import PrintedTable
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Priority, essential_space
from adaptctl.identifiability.energy_matrix import NumericalRank, energies
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.regrouping import removable
from adaptctl.identifiability.sampling import random_states

TIGHT = 1e-8
"""A tolerance that takes what a rounded right angle leaves for independence."""
QUARTERS = {
    "3.1416/2": 3.1416 / 2,
    "3.14159/2": 3.14159 / 2,
    "3.141593/2": 3.141593 / 2,
    "single precision": float(np.float32(np.pi / 2)),
}
"""Right angles (rad) as programs and calculators round them."""
TURNS = (-1, 0, 1, -1, 1, 0)
"""The PUMA's twists, in right angles."""
NULL_COMBINATIONS = ("I_y1 - I_x3 - I_z3", "I_x3 + I_y3 - I_x4 - I_z4", "I_x4 + I_y4 + I_y5 - I_z5 - I_x6 - I_y6")
"""Made of parameters that Table 5 keeps; with exact right angles they change no torque."""
NEGLIGIBLE = 1e-9
"""Of the largest: what lies below is round-off."""


@dataclass(frozen=True, eq=False)
class RoundedSet:
    """Set of the k of P parameters that the paper's rule keeps: `kept`, their indices; the `condition` number of F2'
    V2; and `independent`, the vector D_I (P,) of equation 25, SI units."""

    kept: tuple[int, ...]
    condition: float
    independent: Array


def with_twists(mechanism: Mechanism, quarter: float) -> Mechanism:
    """Copy of a PUMA 560 with `quarter` (rad) in place of pi/2 in all its twists. Raises `ValueError` for a
    `mechanism` of another number of links than six."""
    links = tuple(
        replace(link, far=Pose(rotation_about((1, 0, 0), n * quarter), link.far.translation))
        for link, n in zip(mechanism.links, TURNS, strict=True)
    )
    return Mechanism(replace(mechanism.description, links=links))


def with_base_tilt(mechanism: Mechanism, quarter: float) -> Mechanism:
    """Copy of a semi-direct-drive arm whose first frame is turned about x by minus `quarter` (rad), not pi/2."""
    first = mechanism.links[0]
    base = replace(first, near=Pose(rotation_about((1, 0, 0), -quarter), first.near.translation))
    return Mechanism(replace(mechanism.description, links=(base, *mechanism.links[1:])))


def rounded_set(mechanism: Mechanism, quarter: float, priority: Priority) -> RoundedSet:
    """Set that theorem 4.1 keeps on a PUMA 560 with `quarter` (rad) for pi/2: parameters are removed in the order of
    `priority` where their rows of V2 are independent of those removed before, to 1e-8. Raises `RankError` where the
    rank cannot be certified."""
    space, D = essential_space(with_twists(mechanism, quarter)), mechanism.inertial_parameters
    removed = list(removable(space.null_basis, priority.indices(space.parameter_names), TIGHT))
    kept = tuple(sorted(set(range(len(D))) - set(removed)))
    essential, square = space.project(D), space.null_basis[removed]
    independent = essential - space.null_basis @ np.linalg.solve(square, essential[removed])
    return RoundedSet(kept, float(np.linalg.cond(square)), independent)


def combination(text: str, links: int = 6) -> Array:
    """Coefficients (10 N,) among the parameters of N = `links` links of a `text` such as "I_y1 - I_x3 - I_z3", in the
    paper's names. Raises `ValueError` for an unknown name and a link below 1, `IndexError` for one beyond N."""
    out, texts = np.zeros(10 * links), ("+ " + text).split()
    for mark, term in zip(texts[::2], texts[1::2], strict=True):
        out[index(term[:-1], term[-1])] = sign(term[:-1]) * (1.0 if mark == "+" else -1.0)
    return out


def torque_share(arm: SampledArm, text: str) -> float:
    """Largest torque that the combination `text` of an arm's parameters makes at 500 random states, over the largest
    that one of its terms makes alone: round-off where it changes none. Raises as `combination`."""
    vector = combination(text)
    p, v, a = np.random.default_rng(0).normal(size=(3, 500, arm.mechanism.dof))
    Y = arm.mechanism.torque_regressor(p, v, a)
    return float(np.abs(Y @ vector).max() / np.abs(Y[..., vector != 0.0]).max())


def excess(space: EssentialSpace, real: PrintedTable, essential: PrintedTable, free: Array) -> float:
    """Least possible max_i |(V1 V1' D)_i - E_i| / h_i over all D (P,) that round to the table `real` where `free` (P,)
    of bools allows a difference; E are the numbers of the table `essential` and h half units of their last digits. At
    most 1 means that the tables agree. Raises `ArithmeticError` where the linear program is not solved."""
    project, D, goal = space.basis @ space.basis.T, parameters(real), parameters(essential)
    tolerance = parameters(essential, half_units=True)
    slack = np.where(free, parameters(real, half_units=True), 0.0)
    off = project @ D - goal
    rows = np.concatenate([project / tolerance[:, None], -project / tolerance[:, None]])
    found = linprog(
        np.append(np.zeros(len(D)), 1.0),
        A_ub=np.column_stack([rows, -np.ones(len(rows))]),
        b_ub=np.concatenate([-off / tolerance, off / tolerance]),
        bounds=[*((-x, x) for x in slack), (0.0, None)],
    )
    if found.fun is None:
        raise ArithmeticError(f"the linear program was not solved: {found.message}")
    return float(found.fun)


def scaled_rank(matrix: Array, scales: Array) -> NumericalRank:
    """Numerical rank of a `matrix` (samples, P) of energies, its columns times the `scales` (P,)."""
    return NumericalRank.of(singular_values(matrix * scales))


def undifferenced(mechanism: Mechanism) -> int:
    """Rank of the energies of a `mechanism` that are not subtracted from each other."""
    states = random_states(mechanism, 4 * len(mechanism.parameter_names), np.random.default_rng(0))
    return scaled_rank(energies(mechanism, states), essential_space(mechanism).scales).rank


@dataclass(frozen=True, eq=False)
class Decoupling:
    """Linear relations among the k fundamental parameters of `basis` under which all off-diagonal entries of the mass
    matrix vanish in every configuration (section 5.3): `relations` (m, k), each with one parameter that no other has,
    and `per_term`, how many relations each entry needs alone, by name such as "M12"."""

    basis: FundamentalBasis
    per_term: dict[str, int]
    relations: Array

    @classmethod
    def of(cls, arm: SampledArm, basis: FundamentalBasis) -> Decoupling:
        """Relations that decouple an `arm` at 200 random positions; what is below 1e-9 of the largest counts as
        zero."""
        rows = _off_diagonal_rows(arm, basis.columns)
        _, values, right = np.linalg.svd(np.concatenate(list(rows.values())), full_matrices=False)
        needed = right[: np.count_nonzero(values > NEGLIGIBLE * values[0])]
        return cls(basis, {term: _rank(row) for term, row in rows.items()}, _reduced_rows(needed))

    @property
    def left(self) -> int:
        """Number of independent parameters that are left when all relations hold."""
        return self.basis.rank - len(self.relations)

    def lines(self) -> tuple[str, ...]:
        """Relations as texts such as "link5.mc_x* = 0.6667 link4.mc_x*"; a star marks fundamental parameters."""
        return tuple(_line(row, self.basis.names) for row in self.relations)

    def of_parameters(self) -> Array:
        """Coefficients (m, P) of the relations among all parameters, SI units."""
        return self.relations @ self.basis.regrouping


def _off_diagonal_rows(arm: SampledArm, columns: Sequence[int]) -> dict[str, Array]:
    """Regressors (200, k) of each off-diagonal entry of the mass matrix."""
    weightless = Mechanism(replace(arm.mechanism.description, gravity=np.zeros(3)))
    p, _ = arm.states(np.random.default_rng(0), 200, 1.0)
    rest, unit = np.zeros_like(p), np.eye(arm.mechanism.dof)
    forces = [weightless.torque_regressor(p, rest, rest + unit[j], columns) for j in range(len(unit))]
    return {f"M{i + 1}{j + 1}": forces[j][:, i] for i, j in combinations(range(len(unit)), 2)}


def _reduced_rows(rows: Array) -> Array:
    """Reduced row echelon form, the columns taken from the last to the first."""
    left, done = rows.copy(), 0
    for column in reversed(range(rows.shape[1])):
        if done == len(left):
            break
        pivot = done + int(np.abs(left[done:, column]).argmax())
        if abs(left[pivot, column]) < NEGLIGIBLE:
            continue
        left[[done, pivot]] = left[[pivot, done]]
        left[done] /= left[done, column]
        others = np.arange(len(left)) != done
        left[others] -= np.outer(left[others, column], left[done])
        done += 1
    left[np.abs(left) < NEGLIGIBLE] = 0.0
    return left[:done]


def _rank(rows: Array) -> int:
    values = np.linalg.svd(rows, compute_uv=False)
    return int(np.count_nonzero(values > NEGLIGIBLE * values[0]))


def _line(row: Array, names: Sequence[str]) -> str:
    """``link5.mc_x* = 0.6667 link4.mc_x*``: the row's own parameter on the left."""
    own = int(np.flatnonzero(row)[-1])
    right = [f"{-row[j]:+.4g} {names[j]}*" for j in np.flatnonzero(row)[:-1]]
    return f"{names[own]}* = {' '.join(right).removeprefix('+') or '0'}"


def left_under(arm: SampledArm, relations: int) -> int:
    """Rank of an `arm` that is left under random independent `relations` among its essential parameters."""
    random = np.random.default_rng(0).normal(size=(relations, arm.space.rank))
    _, _, right = np.linalg.svd(random)
    free = arm.space.basis @ right[relations:].T
    differences = np.diff(arm.energies(*arm.states(np.random.default_rng(1), 2 * arm.space.rank, 1.0)), axis=0)
    return int(np.linalg.matrix_rank(differences @ free, rtol=NEGLIGIBLE))


def impossible_moments(mechanism: Mechanism, needs: Decoupling) -> tuple[float, float]:
    """Error (no unit) with which the generic relations add up to l5^2 I4 + l4^2 I5 = 0, and its value (kg m^4)."""
    rod, loops = _length(mechanism, "link5"), mechanism.description.loops
    forearm = float(loops.closures[0].second_frame.translation[0]) if loops else 0.0
    moments = np.zeros(len(mechanism.inertial_parameters))
    moments[30:40] = forearm**2 * _planar_moment(0.0)
    moments[40:50] = rod**2 * _planar_moment(forearm)
    relations = needs.of_parameters()
    weights = np.linalg.lstsq(relations.T, moments)[0]
    return float(np.abs(relations.T @ weights - moments).max()), float(moments @ mechanism.inertial_parameters)


def decoupled(mechanism: Mechanism) -> Mechanism:
    """Decoupled parallelogram: no offsets from the plane, m5 (c5 - l3) = (l3/l2) m4 c4."""
    tens = mechanism.inertial_parameters.reshape(-1, 10).copy()
    upper, crank = _length(mechanism, "link5"), _length(mechanism, "link4")
    for ten in tens[1:]:
        _move(ten, ten[1] / ten[0])
    _move(tens[4], crank + crank / upper * tens[3, 1] / tens[4, 0])
    return mechanism.with_parameters(tens.ravel())


def _move(ten: Array, place: float) -> None:
    """Move a body's centre of mass onto its link's x axis, its tensor there unchanged."""
    mass, center = ten[0], ten[1:4] / ten[0]
    tensor = inertia_tensor(ten) - mass * (center @ center * np.eye(3) - np.outer(center, center))
    ten[:] = from_center_of_mass(mass, np.array([place, 0.0, 0.0]), tensor)


def _planar_moment(place: float) -> Array:
    """The ten coefficients of the integral of (x - place)² + y²."""
    return np.array([place**2, -2.0 * place, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def _length(mechanism: Mechanism, behind: str) -> float:
    """Distance (m) from the joint before a link's joint to it."""
    return float(next(link for link in mechanism.links if link.name == behind).near.translation[0])
