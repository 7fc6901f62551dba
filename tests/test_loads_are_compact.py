"""Loads whose inertia a short motion does not tell, which are taken as compact."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control.adaptation.payload_test import PayloadTest, _is_an_inertia, _point_mass
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column

MASS, CENTER = 2.0, np.array([0.1, -0.05, 0.4])
OWN = np.diag([0.17, 0.16, 0.02])
"""kg m^2 about the center of mass, as of a rod of 1 m"""


@lru_cache
def judge(robot: str) -> PayloadTest:
    arm = adaptctl.load(robot)
    model = ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    return PayloadTest(model, column(np.ones(len(model.names))))


def ten(mass: float, inertia: Any = 0.0) -> Array:
    """Parameters of a load with an inertia about its center of mass."""
    about = mass * (CENTER @ CENTER * np.eye(3) - np.outer(CENTER, CENTER)) + np.sign(mass) * inertia
    return np.array([mass, *mass * CENTER, *about[np.tril_indices(3)]])


def taken(robot: str, load: Array, told: float) -> Array:
    """Load by misses that tell weights well and inertias by so much."""
    known = np.diag([1e4] * 4 + [told] * 6)
    normal, right = column(known[np.triu_indices(10)]), column(known @ load)
    own = column(np.where(np.arange(10) < 4, load, 0.0 if told < 1.0 else load))
    return np.array(list(judge(robot)._compact(own, normal, right)))


@pytest.mark.parametrize("mass", [MASS, -MASS])
def test_what_is_not_told_of_a_load_is_that_of_a_point_mass(mass: float) -> None:
    """Taken or dropped; of one that is a rod, its weight stays right."""
    assert taken("puma560_measured", ten(mass), 1e-6) == pytest.approx(ten(mass), abs=1e-3)
    rod = taken("puma560_measured", ten(mass, OWN), 1e-6)
    assert rod[:4] == pytest.approx(ten(mass)[:4], abs=1e-3)


def test_what_is_told_of_a_load_is_believed() -> None:
    assert taken("puma560_measured", ten(MASS, OWN), 1e4) == pytest.approx(ten(MASS, OWN), abs=0.01)


def test_without_a_mass_of_its_own_no_center_is_known() -> None:
    """A single joint feels the product of a load's mass and distance."""
    arm = adaptctl.load("two_link").locked(("shoulder",))
    model = ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    assert not PayloadTest(model, column(np.ones(len(model.names))))._tells_mass
    assert judge("puma560_measured")._tells_mass


@pytest.mark.parametrize(("angle", "told"), [(2.4e-6, True), (1.6e-6, False)])
def test_effects_that_are_parallel_to_a_millionth_are_of_one_parameter(
    angle: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the mass and of the last entry: half their angle is the ratio of the ends of the spectrum."""
    effect = np.eye(10)
    effect[9] = angle * effect[9]
    effect[0, 9] = 1.0
    monkeypatch.setattr(PayloadTest, "_effect", effect)
    test = judge("two_link")
    assert (test._tells_all, test._tells_mass) == (told, told)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_load_has_an_inertia_that_is_positive_about_all_axes_or_negative(sign: float) -> None:
    """As eigenvalues tell, but for a tenth of its trace and a slack."""
    rng, told = np.random.default_rng(3), []
    for _ in range(60):
        tensor = rng.normal(size=(3, 3))
        tensor = 0.5 * (tensor + tensor.T) + rng.uniform(0.0, 2.5) * np.eye(3)
        least = np.linalg.eigvalsh(tensor)[0] + 0.1 * abs(np.trace(tensor)) + 0.05
        if np.trace(tensor) > 0.0 and abs(least) > 1e-6:
            load = np.concatenate((np.zeros(4), sign * tensor[np.tril_indices(3)]))
            told.append((float(_is_an_inertia(Column(load.tolist()), 0.05)), least > 0.0))
    assert all(found == expected for found, expected in told)
    assert {expected for _, expected in told} == {True, False}


@pytest.mark.parametrize(("mass", "size"), [(2.0, 2.0), (-2.0, 2.0), (0.5, 0.9), (0.001, 0.01)])
def test_a_point_mass_is_at_its_center_and_a_metre_away_at_most(mass: float, size: float) -> None:
    """A load with a larger moment than its mass has at a metre counts as one of so much mass."""
    moment = np.array([0.6, 0.0, -np.sqrt(0.45)]) * (1.0 if size == 0.9 else 0.001)
    inertia, weight = _point_mass(Column([mass, *moment]))
    square = moment @ moment
    tensor = np.sign(mass) / size * (square * np.eye(3) - np.outer(moment, moment))
    np.testing.assert_allclose(inertia, tensor[np.tril_indices(3)], atol=1e-15)
    assert weight == pytest.approx((2.0 * 0.1 * square / size + 0.3**2 * size) ** -2)
