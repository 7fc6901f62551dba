"""Solids by their moments, bounds on both of their sides, and colours by the costs that they stand for."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from designs import task

import adaptctl
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent
from adaptctl.design import Counterweights, DesignTask, MountingBounds, box, camera, gripper, motor, sphere
from adaptctl.design import counterweights as module
from adaptctl.design.added_mass import CostMap
from adaptctl.design.bodies import _mass, _size, ball_tens
from adaptctl.design.counterweights import optimal_counterweights
from adaptctl.design.picture import _moved, colors, norm
from adaptctl.design.simplifications import Simplification
from adaptctl.errors import InputError
from adaptctl.recording.drawing import BODY
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
