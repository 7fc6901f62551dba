"""Inverse Jacobians of a point: their damping, against NumPy's determinants, and axes that it cannot move along."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import from_center_of_mass, random_inertia
from sampled_loops import plant

from adaptctl.arrays import Array
from adaptctl.control import TaskSpaceSlotineLi
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.task_space import _damping_of, _determinant
from adaptctl.description import Description, Joint, Link, Pose
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import column


def jacobian(m: int, least: float) -> Array:
    """A matrix (m, 5) of singular values 1, ..., 1, least."""
    rng = np.random.default_rng(m)
    U, V = np.linalg.qr(rng.normal(size=(m, m)))[0], np.linalg.qr(rng.normal(size=(5, 5)))[0]
    return 0.7 * U @ np.diag([*np.ones(m - 1), least]) @ V[:m]


@pytest.mark.parametrize("m", range(1, 5))
def test_determinants_by_minors_are_numpys(m: int) -> None:
    rows = np.random.default_rng(m).normal(size=(m, m))
    assert _determinant(rows.tolist()) == pytest.approx(np.linalg.det(rows), rel=1e-12)


@pytest.mark.parametrize("m", [2, 3])
@pytest.mark.parametrize("least", [1.0, 0.1, 0.03, 0.02, 0.0])
def test_damping_grows_from_zero_to_a_thousandth_where_a_jacobian_is_nearly_singular(m: int, least: float) -> None:
    """The square of mu over tr(J J')/m is 1e-3 (1 - w/w_0)^2 below w_0 = 3e-3, as the law's docstring says."""
    J = jacobian(m, least)
    gram, mean = J @ J.T, np.trace(J @ J.T) / m
    w = np.linalg.det(gram) / mean**m
    expected = 0.0 if w > 3e-3 else 1e-3 * (1.0 - w / 3e-3) ** 2
    assert _damping_of(gram.tolist()) / mean == pytest.approx(expected, rel=1e-8, abs=1e-15)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_a_point_that_nothing_moves_has_an_inverse_too(m: int) -> None:
    """Without the damping it would be one over zero."""
    damped = _damping_of(np.zeros((m, m)).tolist())
    assert damped > 0.0
    assert np.isfinite(1.0 / damped)


def rod(mass: float) -> Array:
    """Ten numbers of a thin rod of 0.5 m along x."""
    return from_center_of_mass(mass, np.array([0.25, 0.0, 0.0]), np.diag([0.01, 0.04, 0.04]))


def planar(links: int) -> Mechanism:
    """Joints about z in a row, 0.3 m apart: all that they move stays in its plane."""
    rng = np.random.default_rng(0)
    frames = [Pose(np.eye(3), np.array([0.3 if i else 0.0, 0.0, 0.0])) for i in range(links)]
    bodies = [
        Link(f"link{i}", i - 1, Joint(f"joint{i}"), near, Pose.identity(), random_inertia(rng))
        for i, near in enumerate(frames)
    ]
    return Mechanism(Description("planar", tuple(bodies)))


@pytest.mark.parametrize(("reach", "largest"), [(0.99, 20.0), (1.01, 25.0), (1.1, 25.0), (1.5, 25.0)])
def test_a_target_out_of_reach_asks_for_no_large_torques(reach: float, largest: float) -> None:
    """An arm of 1 m and 3.5 kg in a plane without gravity; with an undamped inverse, 7,700 N m at 1.1 m."""
    links = [
        Link("a", -1, Joint("a"), Pose.identity(), Pose.identity(), rod(2.0)),
        Link("b", 0, Joint("b"), Pose(np.eye(3), np.array([0.5, 0.0, 0.0])), Pose.identity(), rod(1.5)),
    ]
    mechanism = Mechanism(Description("planar", tuple(links), gravity=(0.0, 0.0, -9.81)))
    model = ReducedModel.full(mechanism)
    law = TaskSpaceSlotineLi(
        model, 10.0, 5.0, None, model.fundamental_parameters, axes=(0, 1), tool=(0.5, 0.0, 0.0), torque_limits=np.inf
    )
    body, p, none = plant(mechanism, 1e-3), np.array([-0.65, 1.6]), np.zeros(2)
    state, memory, torques = body.init(p, none), law.init(p, none), []
    for _ in range(1500):
        torque, memory = law.step(memory, state.p, state.v, ReferencePoint(np.array([reach, 0.0]), none, none))
        torques.append(torque)
        state = body.step(state, torque)
    assert np.abs(torques).max() < largest
    x = np.array(law.point(column(state.p))[0].of)
    np.testing.assert_allclose(x, [min(reach, 1.0), 0.0], atol=2e-3)


def test_a_point_that_moves_in_a_plane_has_no_third_axis() -> None:
    def along(*axes: int) -> TaskSpaceSlotineLi:
        model = ReducedModel.full(planar(3))
        return TaskSpaceSlotineLi(model, 2.0, np.ones(3), axes=axes, tool=(0.3, 0.0, 0.0))

    assert along(0, 1).axes == (0, 1)
    with pytest.raises(InputError, match="joints move the point of link2 along fewer than 3 axes"):
        along(0, 1, 2)
