"""The PUMA 560 of Sheu and Walker (1991): their tables, and where exact right angles disagree with them.

The paper's products of inertia are +integral xy dm, its order is m, mc, I_x, I_y, I_z, I_xy, I_xz, I_yz.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.inertia import PARAMETERS
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import RankError
from adaptctl.identifiability import (
    EssentialSpace,
    Priority,
    States,
    essential_space,
    fundamental_basis,
    reduce,
    states_within_limits,
)
from adaptctl.identifiability.energy_matrix import NumericalRank, column_scales, energies, energy_differences
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.regrouping import removable
from adaptctl.identifiability.sampling import characteristic_length

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")

KINDS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz")

TABLE_2 = """
4.4E+04 4.1E+04 3.8E+04 3.7E+04 2.8E+04 2.4E+04 2.3E+04 2.0E+04 2.0E+04 1.7E+04 1.6E+04 1.6E+04
1.4E+04 1.2E+04 1.1E+04 1.1E+04 1.0E+04 9.3E+03 8.8E+03 8.0E+03 7.5E+03 7.1E+03 6.6E+03 5.9E+03
5.4E+03 5.0E+03 4.9E+03 4.0E+03 3.8E+03 3.5E+03 3.3E+03 2.6E+03 2.1E+03 1.6E+03 5.5E+01 3.6E+01
"""

TABLE_4 = """
schema = "adaptctl/priority/1"
[grid]
m    = [1, 2, 3, 4, 5, 6]
mc_x = [7, 8, 9, 10, 11, 12]
mc_y = [13, 14, 15, 16, 17, 18]
mc_z = [19, 20, 21, 22, 23, 24]
I_x  = [43, 44, 45, 46, 47, 48]
I_y  = [49, 50, 51, 52, 53, 54]
I_z  = [55, 56, 57, 58, 59, 60]
I_xy = [25, 26, 27, 28, 29, 30]
I_xz = [31, 32, 33, 34, 35, 36]
I_yz = [37, 38, 39, 40, 41, 42]
"""

TABLE_5 = """
. . . . . .
. x x x x x
. x . . . x
. . x x . x
. . x x . x
x x x x x x
. x x x x x
. x x x x x
. x x x x x
. x . . . x
"""

EXACT_TABLE_5 = """
. . . . . .
. x x x x x
. x . . . x
. . x x . x
. . . . . .
x x x x x x
. x x x x x
. x x x x x
. x x x x x
. x x x x x
"""
"""What Table 4 yields with exact right angles."""

TABLE_7 = """
0.000  1.220  1.220  1.150   1.150  1.149
0.000  2.559 -0.007  0.000   0.000  0.000
0.000  0.000  0.211  0.206   0.000  0.000
0.000  0.211 -0.117 -0.000  -0.020 -0.004
0.000  0.748 -0.339 -0.0805  0.008  0.072
0.680 -0.069  0.236  0.131   0.136  0.072
0.000 -0.469  1.018 -0.022   0.042  0.178
0.000  0.000  0.004  0.000   0.000  0.000
0.000  0.019  0.000  0.000   0.000  0.000
0.000  0.000 -0.000  0.000  -0.000  0.000
"""

TABLE_8 = """
0      0      0      0      0      0
0      5.102 -0.102  0.000  0.000  0.000
0      0.000  0      0      0      0.000
0      0      1.172  0.000  0      0.041
0      0      0.490  0.004  0      0.205
1.112 -1.915  0.491  0.003  0.000  0.205
0     -1.567  1.588  0.190  0.170  0.178
0      0.000  0.000  0.000  0.000  0.000
0      0.202  0.000  0.000  0.000  0.000
0      0.000  0      0      0      0.000
"""


def index(kind: str, link: int) -> int:
    return 10 * (link - 1) + PARAMETERS.index(kind)


def parameters(table: str) -> Array:
    """A table of the paper as D (60,), in our order and sign."""
    out = np.zeros(60)
    for kind, row in zip(KINDS, table.strip().splitlines(), strict=True):
        sign = -1.0 if kind in {"I_xy", "I_xz", "I_yz"} else 1.0
        for link, value in enumerate(row.split(), start=1):
            out[index(kind, link)] = sign * float(value)
    return out


def marked(table: str) -> list[int]:
    rows = zip(KINDS, table.strip().splitlines(), strict=True)
    return sorted(
        index(kind, link) for kind, row in rows for link, mark in enumerate(row.split(), start=1) if mark == "x"
    )


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560")


@pytest.fixture(scope="module")
def space(puma: Mechanism) -> EssentialSpace:
    return essential_space(puma)


def with_twists(mechanism: Mechanism, quarter: float) -> Mechanism:
    """The PUMA with pi/2 replaced by a number near it."""
    turns = (-1, 0, 1, -1, 1, 0)
    links = tuple(
        replace(link, joint_to_link=Pose(rotation_about((1, 0, 0), n * quarter), link.joint_to_link.translation))
        for link, n in zip(mechanism.links, turns, strict=True)
    )
    return Mechanism(replace(mechanism.description, links=links))


def kept_by_the_papers_rule(space: EssentialSpace, tolerance: float) -> tuple[list[int], list[int]]:
    """Theorem 4.1 on the unscaled V2, whose rows count as independent above a tolerance: kept and removed."""
    removed = removable(space.null_basis, Priority().indices(space.parameter_names), tolerance)
    return sorted(set(range(60)) - set(removed)), list(removed)


def test_36_of_60_parameters_and_15_of_30_for_the_first_three_joints(space: EssentialSpace) -> None:
    assert space.rank == 36
    assert essential_space(load("puma560_arm3")).rank == 15


def test_table_7(puma: Mechanism, space: EssentialSpace) -> None:
    deviation = np.abs(space.project(puma.inertial_parameters) - parameters(TABLE_7))
    assert deviation.max() < 0.0009
    assert np.count_nonzero(deviation < 0.0005 + 1e-9) == 54


def test_table_4_with_exact_right_angles(puma: Mechanism, space: EssentialSpace, tmp_path: Path) -> None:
    (tmp_path / "table4.toml").write_text(TABLE_4)
    priority = Priority.read(tmp_path / "table4.toml", puma)
    basis = fundamental_basis(space, priority)
    assert list(basis.columns) == marked(EXACT_TABLE_5)
    assert basis.condition == pytest.approx(4.449, abs=1e-3)
    assert fundamental_basis(space).columns == basis.columns
    assert priority.indices(puma.parameter_names) == Priority.default(puma).indices(puma.parameter_names)


def test_the_smallest_equations_of_the_arm(space: EssentialSpace) -> None:
    equations = fundamental_basis(space).equations()
    masses = "link2.m + link3.m + link4.m + link5.m + link6.m"
    assert f"link2.mc_x* = link2.mc_x + 0.4318 ({masses})" in equations
    assert f"link2.I_yy* = link2.I_yy - link2.I_xx - {0.4318**2:.6g} ({masses})" in equations
    assert "link6.I_yy* = link6.I_yy - link6.I_xx" in equations
    assert "link2.I_xy* = link2.I_xy" in equations


def combination(**terms: int) -> Array:
    out = np.zeros(60)
    for term, factor in terms.items():
        out[index(term[:4], int(term[4:]))] = factor
    return out


def test_table_5_has_rank_33_with_exact_right_angles(puma: Mechanism) -> None:
    states = states_within_limits(puma, 201)
    H = energy_differences(puma, states)[:, marked(TABLE_5)]
    assert H.shape[1] == 36
    found = NumericalRank.from_singular_values(singular_values(H / np.linalg.norm(H, axis=0)))
    assert found.rank == 33
    assert found.gap > 1e10


@pytest.mark.parametrize(
    "changes_nothing",
    [
        combination(I_yy1=1, I_xx3=-1, I_zz3=-1),
        combination(I_xx3=1, I_yy3=1, I_xx4=-1, I_zz4=-1),
        combination(I_xx4=1, I_yy4=1, I_yy5=1, I_zz5=-1, I_xx6=-1, I_yy6=-1),
    ],
)
def test_three_combinations_within_table_5_change_no_torque(puma: Mechanism, changes_nothing: Array) -> None:
    assert set(np.flatnonzero(changes_nothing).tolist()) <= set(marked(TABLE_5))
    p, v, a = np.random.default_rng(0).normal(size=(3, 1000, 6))
    Y = puma.torque_regressor(p, v, a)
    assert np.abs(Y @ changes_nothing).max() < 1e-12 * np.abs(Y[..., changes_nothing != 0.0]).max()


@pytest.mark.parametrize("tolerance", [1e-8, 1e-9])
@pytest.mark.parametrize("quarter", [3.1416 / 2, 3.14159 / 2])
def test_table_5_comes_from_rounding_a_right_angle(puma: Mechanism, quarter: float, tolerance: float) -> None:
    rounded = essential_space(with_twists(puma, quarter))
    assert rounded.rank == 36
    kept, removed = kept_by_the_papers_rule(rounded, tolerance)
    assert kept == marked(TABLE_5)
    F2V2 = rounded.null_basis[removed]
    assert 5e5 < np.linalg.cond(F2V2) < 3e6
    essential = rounded.project(puma.inertial_parameters)
    independent = essential - rounded.null_basis @ np.linalg.solve(F2V2, essential[removed])
    np.testing.assert_allclose(independent, parameters(TABLE_8), atol=0.0011)


def test_a_looser_tolerance_does_not_take_rounding_for_independence(puma: Mechanism, space: EssentialSpace) -> None:
    rounded = essential_space(with_twists(puma, 3.1416 / 2))
    assert len(rounded.certificate.near_right_angles) == 4
    assert "rad from 90 degrees" in str(rounded.certificate.near_right_angles[0])
    assert fundamental_basis(rounded).columns == fundamental_basis(space).columns
    assert kept_by_the_papers_rule(space, 1e-8)[0] == marked(EXACT_TABLE_5)


def test_what_the_paper_did_is_refused_for_its_condition(puma: Mechanism) -> None:
    rounded = essential_space(with_twists(puma, 3.1416 / 2))
    with pytest.raises(RankError, match=r"link5\.I_yz and link3\.I_yz, .*condition number [56]\.\de\+05"):
        fundamental_basis(rounded, tolerance=1e-8)


def test_table_8_is_equivalent_to_table_7(puma: Mechanism, space: EssentialSpace) -> None:
    """Its parameters are not independent, but these values of them give the same torques."""
    table_8 = parameters(TABLE_8)
    np.testing.assert_allclose(space.project(table_8), parameters(TABLE_7), atol=0.001)
    np.testing.assert_allclose(space.project(table_8), space.project(puma.inertial_parameters), atol=0.001)
    p, v, a = np.random.default_rng(1).normal(size=(3, 500, 6))
    torque = puma.inverse_dynamics(p, v, a)
    assert np.abs(puma.with_parameters(table_8).inverse_dynamics(p, v, a) - torque).max() < 1e-3 * np.abs(torque).max()


def scaled_rank(mechanism: Mechanism, states: States, differenced: bool) -> int:
    E = energies(mechanism, states)
    scales = column_scales(np.linalg.norm(E, axis=0), mechanism.parameter_names, characteristic_length(mechanism))
    return NumericalRank.from_singular_values(singular_values((np.diff(E, axis=0) if differenced else E) * scales)).rank


def test_16_of_table_13_is_what_energies_give_when_not_subtracted() -> None:
    arm = load("puma560_arm3")
    states = states_within_limits(arm, 101)
    assert scaled_rank(arm, states, differenced=False) == 16
    assert scaled_rank(arm, states, differenced=True) == 15


@pytest.mark.parametrize("seed", range(3))
def test_table_2_in_shape_and_scale(puma: Mechanism, seed: int) -> None:
    """101 samples within Table 1's ranges; its scale is met when the velocities' root mean square, not their
    bound, is Table 1's, and the last two, which gravity alone makes, in either case."""
    uniform = states_within_limits(puma, 101, seed)
    states = States(uniform.p, np.sqrt(3.0) * uniform.v, uniform.origin)
    values = essential_space(puma, states=states).singular_values
    printed = np.array(TABLE_2.split(), dtype=float)
    ratios = values[:36] / printed
    assert 0.8 < np.exp(np.mean(np.log(ratios))) < 1.2
    assert 0.6 < ratios.min() < ratios.max() < 1.6
    assert values[34] < values[33] / 10
    assert values[36] < 1e-12 * values[0]


def test_figure_3_in_shape(puma: Mechanism) -> None:
    """Percent errors 35, 11, 5.3, 0.3 and 0.002 at 10, 25, 30, 34 and 35 components, on samples not printed."""
    uniform = states_within_limits(puma, 101)
    space = essential_space(puma, states=States(uniform.p, np.sqrt(3.0) * uniform.v, uniform.origin))
    errors = reduce(space, puma, components=36).percent_errors
    assert 15 < errors[10] < 50
    assert 2 < errors[25] < 15
    assert 0.5 < errors[30] < 10
    assert errors[34] < 0.5
    assert errors[35] < 0.1
    assert errors[36] == 0.0
