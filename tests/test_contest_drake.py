"""Drake as the plant of a contest, by a double on Pinocchio's dynamics; `make check-neighbours` has Drake itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from drake_double import modules
from random_trees import random_tree

import adaptctl
from adaptctl.contest.drake_plant import DrakePlant
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.simulation.plant import Plant

PERIOD = 1e-3


@pytest.fixture(autouse=True)
def _drake() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, module in modules().items():
            patch.setitem(sys.modules, name, module)
        yield


def driven(seed: int) -> Mechanism:
    """A tree with viscous friction and a rotor at each joint but the last."""
    rng, arm = np.random.default_rng(seed), random_tree(seed, 4)
    drives = [Drive(viscous=float(x), rotor_inertia=float(y)) for x, y in rng.uniform(0.5, 2.0, (3, 2))]
    return arm.with_drives([*drives, Drive()])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drake_moves_trees_as_our_plant_does(seed: int) -> None:
    rng, arm = np.random.default_rng(seed), driven(seed)
    parameters = arm.inertial_parameters.copy()
    parameters[: 10 * (seed == 3)] = 0.0  # a link without mass, on a joint with a rotor
    arm = arm.with_parameters(parameters)
    ours, theirs = Plant(arm, PERIOD, 4), DrakePlant(arm, PERIOD)
    p, v, torque = rng.normal(size=(3, arm.dof))
    other = 1.3 * arm.inertial_parameters
    one, two = ours.init(p, v), theirs.init(p, v)
    assert (two.p.tolist(), two.v.tolist(), two.time) == (p.tolist(), v.tolist(), 0.0)
    for k, parameters in enumerate((None, None, other, other, None), start=1):
        one, two = ours.step(one, torque, parameters), theirs.step(two, torque, parameters)
        np.testing.assert_allclose(two.p, one.p, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(two.v, one.v, rtol=1e-8, atol=1e-8)
        assert two.time == pytest.approx(k * PERIOD)
        assert (two.measured_p.tolist(), two.measured_v.tolist()) == (two.p.tolist(), two.v.tolist())


def test_torques_are_clipped_at_the_limits_and_told() -> None:
    arm = driven(1)
    plant = DrakePlant(arm, PERIOD, torque_limits=np.full(4, 2.0))
    start = plant.init(np.zeros(4), np.zeros(4))
    within, beyond = plant.step(start, [2.0, -2.0, 0.0, 1.0]), plant.step(start, [2.0, -2.1, 0.0, 1.0])
    assert (bool(within.clipped), bool(beyond.clipped)) == (False, True)
    assert beyond.applied_torque.tolist() == [2.0, -2.0, 0.0, 1.0]
    np.testing.assert_array_equal(beyond.p, within.p)


def test_a_motion_that_is_not_finite_is_told() -> None:
    plant = DrakePlant(driven(1), PERIOD)
    state = plant.init(np.zeros(4), np.full(4, 1e200))
    with pytest.raises(NonFiniteError, match="Drake's simulation diverged after 0 s"), np.errstate(all="ignore"):
        plant.step(state, np.zeros(4))


@pytest.mark.parametrize("drive", [Drive(coulomb=0.1), Drive(viscous=1.0, stiffness=0.1)])
def test_drives_that_drake_has_not_are_refused(drive: Drive) -> None:
    arm = random_tree(1, 2).with_drives([Drive(viscous=1.0, coulomb=0.0), drive])
    plant = DrakePlant(arm, PERIOD)
    with pytest.raises(InputError, match="joint 'joint1': Drake has only viscous friction and rotors"):
        plant.step(plant.init(np.zeros(2), np.zeros(2)), np.zeros(2))


def test_loops_are_refused() -> None:
    arm = adaptctl.load(Path(__file__).parent / "golden" / "files" / "closed.toml")
    plant = DrakePlant(arm, PERIOD)
    with pytest.raises(InputError, match="the plant drake has no closed loops"):
        plant.step(plant.init(np.zeros(arm.dof), np.zeros(arm.dof)), np.zeros(arm.dof))
