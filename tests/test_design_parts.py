"""Solids by their moments, bounds on both of their sides, and colours by the costs that they stand for."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from designs import task
from two_links import ARM, changed

import adaptctl
from adaptctl.description import JointKind
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent
from adaptctl.design import (
    AddedMass,
    Counterweights,
    DesignTask,
    MountingBounds,
    box,
    camera,
    gripper,
    motor,
    point,
    sphere,
)
from adaptctl.design import counterweights as module
from adaptctl.design.added_mass import CostMap
from adaptctl.design.bodies import _mass, _size, ball_tens
from adaptctl.design.counterweights import optimal_counterweights
from adaptctl.design.driving import Demand
from adaptctl.design.picture import _moved, colors, norm
from adaptctl.design.report import _place, _run_words, _runs
from adaptctl.design.simplifications import Simplification, _independent_columns, _least_mass
from adaptctl.errors import InputError
from adaptctl.recording.colors import BODY
from adaptctl.simulation.effects import Payload


def moments(mass: float, squares: Any) -> np.ndarray:
    """Of a solid whose points are on average so far from its centre, squared, along each axis."""
    each = np.asarray(squares)
    return mass * (each.sum() - each)


def test_moments_of_boxes_and_balls_are_those_of_their_points() -> None:
    edges = np.array([0.1, 0.2, 0.35])
    np.testing.assert_allclose(np.diag(box(2.5, edges).inertia), moments(2.5, edges**2 / 12.0))
    ball = sphere(3.0, density=5000.0)
    radius = np.cbrt(3.0 / 5000.0 / (4.0 / 3.0 * np.pi))
    np.testing.assert_allclose(ball.inertia, np.diag(moments(3.0, np.full(3, radius**2 / 5.0))))
    place = np.array([0.1, -0.2, 0.4])
    ten = from_center_of_mass(3.0, place, np.asarray(ball.inertia))
    np.testing.assert_allclose(ball_tens(3.0, place, 5000.0), ten)


@pytest.mark.parametrize("made", [gripper, motor, camera])
def test_common_bodies_have_the_masses_and_sizes_that_they_state(made: Any) -> None:
    told = made.__doc__.strip().splitlines()[0]
    (mass,), sizes = (
        re.findall(r"of ([\d.]+) kg", told),
        [1e-3 * float(x) for x in re.findall(r"\d+(?=,| and| mm)", told)],
    )
    body: Payload = made()
    assert body.mass == float(mass)
    if made is camera:
        expected = moments(body.mass, np.square(sizes) / 12.0)
    else:
        across, long = sizes
        expected = moments(body.mass, [across**2 / 16.0, across**2 / 16.0, long**2 / 12.0])
    np.testing.assert_allclose(body.inertia, np.diag(expected))


def test_masses_and_sizes_of_solids_are_bounded_on_both_sides() -> None:
    assert [_mass(0.0), _mass(1e20), _size("size", 1e-100), _size("size", 1e100)] == [0.0, 1e20, 1e-100, 1e100]
    for x in (-1e-300, 1.01e20):
        with pytest.raises(InputError, match="mass: expected a number of at least 0 kg"):
            _mass(x)
    for x in (0.9e-100, 1.1e100):
        with pytest.raises(InputError, match="size: expected a number above 0"):
            _size("size", x)


def test_states_are_a_motion_that_differ_by_a_billionth() -> None:
    arm, still = task("semi_direct_drive").mechanism, np.zeros((2, 3))
    for which in range(2):
        for apart, moves in ((1.1e-9, True), (0.9e-9, False)):
            states = [still.copy(), still.copy(), still]
            states[which][1, 2] = apart
            if moves:
                assert len(DesignTask(arm, *states, "").p) == 2
            else:
                with pytest.raises(InputError, match="the states are all equal"):
                    DesignTask(arm, *states, "")


def test_counterweights_of_less_than_a_millionth_of_what_is_allowed_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    T = task("semi_direct_drive", 50)
    places = [MountingBounds.for_link(T.mechanism, name, 0.3) for name in ("link2", "link3")]
    design = np.array([0.9e-6, 0.5, 0.5, 0.5, 1.1e-6, 0.5, 0.5, 0.5])
    monkeypatch.setattr(module._Search, "least", lambda *_: design)
    (found,) = optimal_counterweights(T, places).weights
    assert (found.link, found.mass) == ("link3", pytest.approx(1.1e-6 * places[1].mass))


def test_what_costs_nothing_is_not_reduced() -> None:
    arm: Any = SimpleNamespace(cost=lambda objective: 0.0)
    balanced = Counterweights(arm, "coupling", 1.0, (), (), 0)
    vars(balanced)["balanced_task"] = arm
    assert balanced.relative_reduction == 0.0


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_links_that_no_body_can_have_are_named() -> None:
    arm = adaptctl.load("puma560")
    wrong = [link.name for link in arm.links if not is_physically_consistent(link.inertia)]
    found = Counterweights(DesignTask.within_limits(arm, 10), "energy", 1.0, (), (), 0).inconsistent
    assert 0 < len(found) < len(arm.links)
    assert list(found) == wrong


@pytest.mark.parametrize(
    ("least", "changes", "ends"),
    [
        (-0.2, [-0.1, 0.3], (-0.2, 0.3)),
        (-0.2, [-0.3, -0.1], (-0.3, 3e-4)),
        (0.1, [0.2, 0.5], (-5e-4, 0.5)),
        (0.0, [0.0, 0.0], (-1e-12, 1e-12)),
    ],
)
def test_no_change_of_cost_is_in_the_middle_of_the_colours(
    least: float, changes: list[float], ends: tuple[float, float]
) -> None:
    study: Any = SimpleNamespace(links=[SimpleNamespace(least=least), SimpleNamespace(least=0.4)])
    scale = norm(study, np.array(changes))
    assert (scale.vmin, scale.vcenter, scale.vmax) == pytest.approx((ends[0], 0.0, ends[1]))
    middle, *_, low, high = colors(np.array([0.0, *ends]), scale).astype(int)
    np.testing.assert_allclose(middle[:3], [BODY.red, BODY.green, BODY.blue], atol=2)
    assert low[2] > low[0] + 50, "blue"
    assert high[0] > high[2] + 50, "red"


def test_of_a_long_run_at_most_600_positions_are_shown() -> None:
    time, p = np.linspace(0.0, 5.0, 1801), np.linspace(0.0, 1.0, 3602).reshape(1801, 2)
    last: Any = SimpleNamespace(time=time, p=p)
    shown, moved = _moved(SimpleNamespace(), [SimpleNamespace(), last])  # type: ignore[arg-type, list-item]
    assert 300 < len(shown) <= 600
    np.testing.assert_array_equal(moved, p[np.searchsorted(time, shown)])


def test_a_cost_map_is_of_the_change_by_its_own_mass() -> None:
    T = task("puma560_measured", 50)
    place = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    for mass in (0.5, 2.0):
        found = CostMap(T, mass, "energy").at("link3", place)
        for x, change in zip(place, found, strict=True):
            D = np.array(T.parameters)
            D[20:30] += mass * np.array(
                [1, *x, x[1] ** 2 + x[2] ** 2, -x[0] * x[1], x[0] ** 2 + x[2] ** 2, -x[0] * x[2], -x[1] * x[2],
                 x[0] ** 2 + x[1] ** 2]
            )  # fmt: skip
            assert change == pytest.approx(T.cost("energy", D) / T.cost("energy") - 1.0)


def test_a_place_on_an_axis_has_no_sign() -> None:
    made = Simplification(
        task("semi_direct_drive").basis, "balance", "link2", (), (), np.zeros((0, 0)), (), 1.0, -np.zeros(3)
    )
    assert made.description.endswith("at (0.000, 0.000, 0.000) m")


@pytest.mark.parametrize(
    ("wanted", "taken", "mass", "end"),
    [
        (0.15, 0.0, 0.75, 0.2),
        (0.6, 0.0, 3.0, 0.2),  # all that is allowed
        (0.6 * (1.0 + 1e-10), 0.0, None, 0.2),
        (0.15, 0.1, 1.5, 0.2),  # taken from 0.1 m
        (-0.3, 0.1, 1.5, -0.1),
        (0.31, 0.1, None, 0.2),
        (0.0, 0.0, None, 0.2),
    ],
)
def test_a_first_moment_is_changed_by_the_least_mass_at_an_end(
    wanted: float, taken: float, mass: float | None, end: float
) -> None:
    places = MountingBounds("link3", np.array([-0.1, 0.0, 0.0]), np.array([0.2, 0.0, 0.0]), 3.0)
    found = _least_mass(np.eye(10)[1], wanted, taken, places, 7850.0)
    assert (found is None) == (mass is None)
    if found is not None:
        assert (found[0], found[1][0]) == pytest.approx((mass, end))


def test_places_of_balls_are_13_along_each_edge() -> None:
    """The moment 0.68 m x - m x^2 is largest at 0.34 m, between two of them."""
    places = MountingBounds("link3", np.zeros(3), np.array([1.2, 0.0, 0.0]), 1.0)
    found = _least_mass(0.68 * np.eye(10)[1] - np.eye(10)[6], 0.05, 0.0, places, 1e9)
    assert found is not None
    assert found[1] == pytest.approx([0.3, 0.0, 0.0])


@pytest.mark.parametrize(
    ("K", "columns"),
    [
        ([[1, 0, 9, 9], [0, 1, 9, 9]], (0, 1)),
        ([[1, 0, 0.5, 0], [0, 0, 1, 1]], (0, 2)),
        ([[1, 2, 3, 4], [0, 0, 0, 0]], (0,)),
        ([[1, 0, 0, 0], [0, 0, 0.45e-2, 0]], (0,)),  # a fifth of it, in the units of both parameters
        ([[1, 0, 0, 0], [0, 0, 0.55e-2, 0]], (0, 2)),
    ],
)
def test_own_columns_are_kept_before_others(K: Any, columns: tuple[int, ...]) -> None:
    basis: Any = SimpleNamespace(columns=(0, 1), scales=np.array([1.0, 10.0, 2.0, 1.0]))
    assert _independent_columns(np.array(K, dtype=float), basis) == columns


def test_a_slide_counts_in_couplings_by_the_length_of_the_arm() -> None:
    """The lower link slides; it is mounted 0.4 m from the shoulder."""
    arm = changed(lambda joint: replace(joint, kind=JointKind.PRISMATIC, axis=np.array([0.0, 1.0, 0.0])), 1)
    T = DesignTask.within_limits(arm, 20)
    M = arm.mass_matrix(T.p)
    assert np.abs(M[:, 0, 1]).min() > 0.1
    assert T.cost("coupling") == pytest.approx(0.4 * np.sqrt(np.mean(M[:, 0, 1] ** 2)))


def test_faster_tasks_are_the_same_but_for_their_limits() -> None:
    free = changed(lambda joint: replace(joint, limits=replace(joint.limits, velocity=np.inf)))
    slow, fast = (DesignTask.within_limits(free, 30, speed=speed) for speed in (0.5, 1.5))
    np.testing.assert_array_equal(slow.p, fast.p)
    np.testing.assert_allclose(fast.v, 3.0 * slow.v)
    np.testing.assert_allclose(fast.a, 9.0 * slow.a)
    rate = np.sqrt(9.81 / 0.4)  # of an upper link of 0.4 m
    assert np.sqrt(np.mean(fast.v**2)) == pytest.approx(1.5 * rate, rel=0.3)
    assert np.sqrt(np.mean(fast.a**2)) == pytest.approx((1.5 * rate) ** 2, rel=0.3)
    assert DesignTask.within_limits(ARM, 2, speed=0.0).v.tolist() == [[0.0, 0.0]] * 2
    limited = DesignTask.within_limits(ARM, 30, speed=1.5)
    np.testing.assert_allclose(limited.v, np.clip(fast.v, -6.0, 6.0))


def test_changes_of_a_billionth_of_the_largest_are_none() -> None:
    T = task("semi_direct_drive", 50)
    basis = T.basis
    change = np.zeros(len(T.parameters))
    change[basis.columns[0]] = 0.5
    found = AddedMass(T, "link2", point(1.0), 1.0)
    for share, count in ((0.55e-9, 2), (0.45e-9, 1)):
        change[basis.columns[1]] = share
        vars(found)["parameter_change"] = change
        vars(found).pop("base_parameter_changes", None)
        assert [name for name, _ in found.base_parameter_changes] == list(basis.names[:count])


def driven_arm(name: str, final: float | None, work: float) -> Any:
    demand = Demand(0.1, final, 0.25, work, 3.0, stopped=final is None)
    return SimpleNamespace(name=name, label=name, demand=demand)


@pytest.mark.parametrize(
    ("works", "share"), [((0.4, 0.5), "+25 %"), ((4.0, 3.0), "−25 %"), ((4.0, 4.0), "+0 %"), ((0.0, 1.0), None)]
)
def test_closed_loops_are_told_by_the_work_of_all_and_the_errors_of_few(
    works: tuple[float, float], share: str | None
) -> None:
    runs = [driven_arm(f"{kind}-{when}", 0.02 / (k + 1), works[k] if kind == "all" else 9.0)
            for k, when in enumerate(("before", "after")) for kind in ("all", "few")]  # fmt: skip
    study: Any = SimpleNamespace(task=SimpleNamespace(mechanism=ARM))
    *work, errors = _run_words(study, runs)
    assert [share in text for text in work if share] == [True] * (share is not None)
    assert len(work) == (share is not None)
    assert "from 20 mrad to 10 mrad" in errors
    assert list(_run_words(study, [])) == []
    table = _runs([driven_arm("all-before", 0.02, 4.0), driven_arm("few-before", None, 0.5)])
    assert [list(row) for row in table.rows] == [
        ["all-before", "0.1", "0.02", "25 %", "4 J"], ["few-before", "0.1", "stopped at 3 s", "25 %", "0.5 J"],
    ]  # fmt: skip


def test_a_place_is_written_in_millimetres_and_without_a_negative_zero() -> None:
    assert _place(np.array([-0.0, 0.12345, -1.0])) == "(0.000, 0.123, -1.000)"
