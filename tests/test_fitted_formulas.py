"""Fits, jackknives, units and loads of identification, against ones that are written otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor
from adaptctl.identification import IdentifiedPayload, energy_differences, listed_hypotheses
from adaptctl.identification.choice import _near, _worse_by
from adaptctl.identification.entropic import prior_links
from adaptctl.identification.filtered_dynamics import COLUMNS, Rows, SmoothMotion
from adaptctl.identification.hypothesis_rows import _thinned
from adaptctl.identification.least_squares import each_weighted
from adaptctl.identification.listed_hypotheses import _mixing, _own_unit, _scales
from adaptctl.identification.loaded_fit import _covariance
from adaptctl.identification.momentum_balance import DIFFERENCE_MARGIN, _balance
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.uncertainty import _blocks
from adaptctl.identification.validation import _is_needed
from adaptctl.identification.written import _two_terms

rng = np.random.default_rng(11)


@dataclass(frozen=True)
class Motion:
    """What is thinned of a smoothed motion."""

    position: Array
    velocity: Array
    rate: float
    every: int


def test_changed_torque_columns_are_other_torques_of_the_joints() -> None:
    """Of a coupled transmission: columns times constants are motors' torques, which the transmission makes joints'."""
    T, constants = np.array([[1.0, 0.0], [-0.5, 2.0]]), np.array([3.0, -0.2])
    rows: Any = SimpleNamespace(evidence=SimpleNamespace(drives=SimpleNamespace(transmission=T, constants=constants)))
    columns, change = rng.normal(size=(6, 2)), rng.normal(size=(2, 2))
    before, after = ((given * constants) @ T for given in (columns, columns @ change.T))
    np.testing.assert_allclose(before @ _mixing(rows, change).T, after, atol=1e-12)


@pytest.mark.parametrize(
    ("ends", "factor", "units"),
    [
        ((0.0, 11.0), 1.0, []),  # rad, in which an arm moves so
        ((0.0, 13.0), 1.0, ["deg"]),
        ((0.0, 0.9), 1.0, ["rev"]),
        ((0.0, 0.19), 1.0, ["rev"]),
        ((0.0, 0.02), 1.0, []),
        ((0.0, 699.0), 1.0, ["deg"]),
        ((0.0, 701.0), 1.0, []),
        ((0.0, 0.031), 1.0, ["rev"]),
        ((0.0, np.radians(13.0)), np.pi / 180.0, []),
        ((0.0, np.radians(11.0)), np.pi / 180.0, ["rad"]),
    ],
)
def test_other_units_are_those_in_which_a_joint_moves_usual_ways(
    ends: tuple[float, float], factor: float, units: list[str]
) -> None:
    drives = SimpleNamespace(motors=[None, SimpleNamespace(position="q2")], position_factors=[1.0, factor])
    evidence = SimpleNamespace(drives=drives, mechanism=SimpleNamespace(dof=2))
    rows: Any = SimpleNamespace(evidence=evidence, position=np.column_stack([np.zeros(2), ends]))
    found = [one.words for one in _own_unit(rows, 1)]
    assert found == [f"column 'q2' is in {unit}, not {'rad' if factor == 1.0 else 'deg'}" for unit in units]


@pytest.mark.parametrize("which", [[0, 1, 2], [2, 3, 4], [1, 3], [], [4]])
def test_chosen_rows_are_those_of_a_mask(which: list[int]) -> None:
    values = {name: rng.normal(size=(5, 2)) for name in COLUMNS}
    found = Rows(9.0, *values.values()).chosen(np.isin(range(5), which))  # type: ignore[arg-type]
    for name, own in values.items():
        np.testing.assert_array_equal(getattr(found, name), own[which])
    assert np.shares_memory(found.time, values["time"]) == (len(which) > 0 and which != [1, 3])


def test_momenta_of_polynomials_have_their_rates() -> None:
    """Less forces, at the instants that have neighbours enough."""
    time = 0.01 * np.arange(12)
    inner = slice(DIFFERENCE_MARGIN, -DIFFERENCE_MARGIN)
    momentum, rate = np.stack([time**3, 2.0 * time], axis=1), np.stack([3.0 * time**2, 0.0 * time + 2.0], axis=1)
    forces = rng.normal(size=(12, 2))
    np.testing.assert_allclose(_balance(momentum, forces, 100.0), (rate - forces)[inner], atol=1e-10)


def test_a_motion_is_thinned_to_a_dozen_instants_in_a_period_of_its_band() -> None:
    time = 0.002 * np.arange(500)
    motion: Any = Motion(np.sin(time)[:, None], np.cos(time)[:, None], 500.0, 3)
    thin, acceleration = _thinned(motion, 10.0)
    assert (thin.every, len(thin.position)) == (18, 84)  # 500 over 80 whole
    np.testing.assert_allclose(acceleration[2:-2, 0], -np.sin(time[::6][2:-2]), atol=1e-3)
    np.testing.assert_array_equal(thin.velocity, motion.velocity[::6])
    assert _thinned(motion, 100.0)[0].every == 3


@pytest.mark.parametrize(
    ("ratios", "near"),
    [([1.0, 1.02, 1.04], [0, 1]), ([1.2, 1.22, 1.25], [0, 1]), ([0.9, 1.02, 1.04], [0, 1]), ([1.04, 1.2], [0])],
)
def test_priors_are_near_the_best_within_three_hundredths(ratios: list[float], near: list[int]) -> None:
    """Of least squares, or of the lightest prior where none is as near as that."""
    assert _near(list(range(len(ratios))), ratios) == near  # type: ignore[arg-type]


def test_squares_are_worse_by_standard_errors_of_their_sum() -> None:
    squares, others = rng.normal(size=5) ** 2 + 1.0, rng.normal(size=5) ** 2
    more = squares - others
    error = np.sqrt(5.0 * np.sum((more - more.mean()) ** 2) / 4.0)
    assert _worse_by(squares, others) == pytest.approx(more.sum() / error)
    assert _worse_by(np.append(squares, np.inf), np.append(others, 0.0)) == np.inf


def test_normal_equations_of_blocks_are_of_what_is_fitted() -> None:
    A, b, x = rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 4)), rng.normal(size=4)
    mask = np.array([True, False, True, True])
    settings = SimpleNamespace(columns=lambda mechanism: mask)
    evidence: Any = SimpleNamespace(
        mechanism=None, blocks=3,
        equations=lambda _, own: SimpleNamespace(whitened=lambda deviations: (A[own[0]], b[own[0]])),
    )  # fmt: skip
    fit: Any = SimpleNamespace(settings=settings, deviations=None, x=x)
    for k, (own, slope) in enumerate(_blocks(evidence, fit)):
        kept = np.ix_(mask, mask)
        np.testing.assert_allclose(own[kept], A[k][kept])
        assert not own[1].any()
        assert not own[:, 1].any()
        np.testing.assert_allclose(slope[mask], A[k][kept] @ x[mask] - b[k][mask])
        assert slope[1] == 0.0


def test_links_that_no_body_can_be_are_told_and_made_balls() -> None:
    """Of aluminium, 2,700 kg/m^3."""
    good = from_center_of_mass(2.0, [0.1, 0.0, 0.0], 0.02 * np.eye(3))
    bad = from_center_of_mass(3.0, [0.0, 0.1, 0.0], -0.02 * np.eye(3))
    links = [SimpleNamespace(name=name, inertia=ten) for name, ten in (("a", good), ("b", bad))]
    arm: Any = SimpleNamespace(name="arm", links=links, description=SimpleNamespace(bodies=(0, 1)))
    tens, remarks = prior_links(arm)
    assert [remark.partition(":")[0] for remark in remarks] == ["b"]
    np.testing.assert_array_equal(tens[0], good)
    np.testing.assert_array_equal(tens[1][:4], bad[:4])


def test_loads_are_told_as_controllers_of_arms_take_them() -> None:
    own = np.array([[0.3, 0.01, -0.02], [0.01, 0.4, 0.03], [-0.02, 0.03, 0.5]])
    ten = from_center_of_mass(2.0, [0.1, -0.2, 0.3], own)
    load = IdentifiedPayload("a", "b", ten, np.eye(10)).set_load()
    assert load["center_of_mass"] == pytest.approx([0.1, -0.2, 0.3])
    assert load["inertia"] == pytest.approx(own.ravel().tolist())
    assert load["inertia_six"] == pytest.approx([0.3, 0.4, 0.5, 0.01, -0.02, 0.03])
    assert inertia_tensor(ten)[0, 0] > own[0, 0]


@pytest.mark.parametrize(
    ("octave", "found"), [(7.3, 7.25), (-9.1, -9.0), (0.6, 1.0), (1.8, 1.75), (-0.2, -1.0), (12.3, 11.0)]
)
def test_the_scale_of_one_torque_is_found_to_a_quarter_of_an_octave(
    octave: float, found: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of ten octaves either way; what is within one is a calibration."""

    def best(rows: Any, j: int, factors: Array) -> float:
        return float(factors[np.argmin(np.abs(np.log2(factors) - octave))])

    monkeypatch.setattr(listed_hypotheses, "_best_scale", best)
    scaled: list[float] = []
    monkeypatch.setattr(listed_hypotheses, "_scale", lambda rows, j, factor: scaled.append(float(np.log2(factor))))
    monkeypatch.setattr(listed_hypotheses, "_mixing", lambda rows, change: None)
    motors = [SimpleNamespace(torque="a"), SimpleNamespace(torque="b")]
    rows: Any = SimpleNamespace(evidence=SimpleNamespace(drives=SimpleNamespace(motors=motors)), mixed=len)
    told = [one.words for one in _scales(rows)]
    assert scaled == pytest.approx([found] * 2)
    assert told[1] == f"column 'b' is about {2.0**-found:.2g} times the torque, beside the others"
    rows.evidence.drives.motors = motors[:1]
    assert not list(_scales(rows))


def test_the_covariance_of_a_fit_is_the_jackknife_of_its_blocks() -> None:
    """Without a prior that of least squares without each of six blocks (Efron 1982)."""
    Y, t, block = rng.normal(size=(60, 3)), rng.normal(size=60), np.repeat(np.arange(6), 10)
    x = np.linalg.lstsq(Y, t)[0]
    each = np.array([np.linalg.lstsq(Y[block != k], t[block != k])[0] for k in range(6)])
    off = each - each.mean(axis=0)

    def linearised(blocks: list[int], *_: object) -> tuple[Array, Array]:
        here = np.isin(block, blocks)
        return Y[here].T @ Y[here], Y[here].T @ t[here]

    class Blocks(list[int]):
        count = np.zeros(6)

        def over(self, blocks: list[int]) -> list[int]:
            return blocks

    prior = SimpleNamespace(tens=np.zeros(0), hold=lambda *_: np.zeros((3, 3)), distance=lambda _: 5.0)
    problem: Any = SimpleNamespace(
        unknown=[], prior=prior, equations=Blocks(range(6)), linearised=linearised, pinned=lambda A, b: (A, b)
    )
    found = _covariance(problem, x, np.zeros(0), None)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, 5.0 / 6.0 * off.T @ off, rtol=1e-9)


def test_a_joints_friction_is_needed_where_rows_are_fitted_much_worse_without() -> None:
    names = ("a.m", "j.viscous", "k.viscous", "j.coulomb")
    Y = rng.normal(size=(80, 4))
    mechanism = SimpleNamespace(parameter_names=names, num_energy_parameters=1)
    evidence: Any = SimpleNamespace(mechanism=mechanism, independent=lambda settings: np.arange(4))
    for needed in ("j.", "k."):
        t = Y[:, 0] + 2.0 * Y[:, names.index(f"{needed}viscous")] + rng.normal(size=80)
        equations: Any = SimpleNamespace(
            whitened=lambda deviations, t=t: (Y.T @ Y, Y.T @ t),
            misfit=lambda x, t=t: np.array([np.sum((t - Y @ x) ** 2)]),
        )
        for joint in ("j.", "k."):
            assert _is_needed(evidence, equations, joint, np.ones(1)) is (joint == needed)


def test_torques_later_are_those_of_the_filter_then_and_their_rates() -> None:
    """Of slow motions, which the filter leaves as they are."""
    time = 0.002 * np.arange(2000)
    log = SimpleNamespace(rate=500.0, time=5.0 + time, torque=np.stack([np.sin(3.0 * time), time**2], axis=1))
    motion: Any = SimpleNamespace(log=log)
    at = np.array([1.0, 1.5, 2.0])
    rise, rates = SmoothMotion.later(motion, 20.0, 5.0 + at, 0.03)
    later = at + 0.03
    np.testing.assert_allclose(rise, np.stack([np.sin(3.0 * later) - np.sin(3.0 * at), later**2 - at**2], 1), atol=2e-3)
    np.testing.assert_allclose(rates, np.stack([3.0 * np.cos(3.0 * later), 2.0 * later], 1), atol=2e-2)


def test_the_rise_of_energy_and_what_friction_takes_are_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """In windows of a tenth of a second, each a tenth of it after the one before."""
    arm = adaptctl.load("two_link").with_drives(Drive(0.1, viscous=0.7, coulomb=0.4))
    time = 0.001 * np.arange(1500)[:, None]
    waves = np.array([2.0, 3.0])
    p, v, a = 0.5 * np.sin(waves * time), 0.5 * waves * np.cos(waves * time), -0.5 * waves**2 * np.sin(waves * time)
    motion: Any = SimpleNamespace(position=p, velocity=v, rate=1000.0)
    monkeypatch.setattr(energy_differences, "_torque", lambda motion: arm.inverse_dynamics(p, v, a))
    rises, work = energy_differences._of_motion(motion, arm, 0.1)
    assert len(work) == len(range(0, 1400, 10))
    np.testing.assert_allclose(rises @ arm.inertial_parameters, work, atol=1e-4 * np.abs(work).max())


def test_friction_of_two_terms_is_written_as_it_is() -> None:
    """Of a joint whose shaft another one turns too, and of none."""
    drives = [Drive(viscous=2.0, coulomb=3.0), Drive(), Drive(viscous=0.5, coulomb=1.0, turns_with=(("a", 0.0001),))]
    joints = [SimpleNamespace(name=name, drive=drive) for name, drive in zip("abc", drives, strict=True)]
    arm: Any = SimpleNamespace(primary_joints=joints)
    found = _two_terms(arm, rng.normal(size=(200, 3)))
    assert found[0] == pytest.approx((2.0, 3.0), abs=1e-3)
    assert found[1] == (None, None)
    assert found[2] == pytest.approx((0.5, 1.0), abs=1e-3)


def reweighted(Y: Array, torque: Array, used: Array) -> tuple[Array, Array]:
    """Three rounds of least squares on rows over deviations, which are first the torques' own, at least a millionth."""
    rms = np.sqrt(np.sum(torque**2 * used, axis=0) / np.maximum(used.sum(axis=0), 1))
    first = np.where(rms > 0.0, rms, max(rms.max(), 1.0))
    deviations = first
    for _ in range(3):
        weight = used / deviations
        x = np.linalg.lstsq((Y * weight[..., None]).reshape(-1, Y.shape[-1]), (torque * weight).ravel())[0]
        left = (torque - Y @ x) ** 2 * used
        deviations = np.maximum(np.sqrt(left.sum(axis=0) / np.maximum(used.sum(axis=0), 1)), 1e-6 * first)
    return x, deviations


def test_joints_are_weighted_anew_by_what_least_squares_leaves_of_their_torques() -> None:
    """In blocks: of much noise, torques of zero, none at all, a single row, and torques that are explained."""
    own, Y = np.random.default_rng(5), np.random.default_rng(4).normal(size=(5, 40, 2, 4))
    torque, used = Y @ [0.3, -0.2, 0.0, 0.1] + own.normal(size=(5, 40, 2)) * [0.02, 0.2], np.ones((5, 40, 2))
    torque[1, :, 1], used[2, :, 1], used[3, 1:, 1] = 0.0, 0.0, 0.0
    torque[4] = Y[4] @ [0.3, -0.2, 0.0, 0.1]
    weighted, columns = Y * used[..., None], np.array([3, 0, 1])
    equations = NormalEquations(
        np.einsum("bnji,bnjk->bjik", weighted, Y),
        np.einsum("bnji,bnj->bji", weighted, torque),
        np.sum(torque**2 * used, axis=1),
        used.sum(axis=1),
    )
    x, deviations = each_weighted(equations, columns)
    for b in range(5):
        expected, spread = reweighted(Y[b][..., columns], torque[b], used[b])
        np.testing.assert_allclose(x[b, columns], expected, rtol=1e-5)
        np.testing.assert_allclose(deviations[b], spread, rtol=1e-4)
    assert not x[:, 2].any()
