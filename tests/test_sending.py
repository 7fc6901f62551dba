"""What can be sent: copies and pickles do as their originals, native code and caches left behind."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

import adaptctl.envs  # noqa: F401  # registers
from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import Controller, PDGravity, ReferencePoint
from adaptctl.dynamics import Mechanism, load
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis, reduce
from adaptctl.simulation import Plant

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")

WAYS: tuple[Callable[[Any], Any], ...] = (copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x)))
ROBOTS = ("puma560_measured", "semi_direct_drive")


@pytest.fixture(scope="module", params=ROBOTS)
def arm(request: pytest.FixtureRequest) -> Mechanism:
    return load(request.param)


def ticks(controller: Controller[Any], arm: Mechanism, count: int = 5) -> Array:
    """Torques of some ticks."""
    state, rest = controller.init(arm.neutral_configuration, np.zeros(arm.dof)), np.zeros(arm.dof)
    out = []
    for k in range(count):
        reference = ReferencePoint(arm.neutral_configuration + 0.01 * k, rest + 0.1, rest)
        torque, state = controller.step(state, arm.neutral_configuration + 0.005 * k, rest, reference)
        out.append(torque)
    return np.array(out)


def controllers(arm: Mechanism) -> Iterator[Controller[Any]]:
    model = ReducedModel(arm)
    yield PDGravity(arm, np.full(arm.dof, 100.0), np.full(arm.dof, 10.0))
    yield PDGravity.from_model(model, 100.0, 10.0)


def test_mechanisms_bases_and_models(arm: Mechanism) -> None:
    space = essential_space(arm)
    basis = fundamental_basis(space)
    model = ReducedModel(arm, basis)
    p, v = arm.neutral_configuration + 0.01, np.ones(arm.dof)
    for sent in WAYS:
        assert sent(arm).description == arm.description
        np.testing.assert_array_equal(sent(arm).inverse_dynamics(p, v, v), arm.inverse_dynamics(p, v, v))
        np.testing.assert_array_equal(sent(space).singular_values, space.singular_values)
        # A copy decomposes again, and what LAPACK adds up depends on where its arrays lie.
        np.testing.assert_allclose(sent(space).null_basis, space.null_basis, rtol=0, atol=1e-13)
        assert sent(basis).equations() == basis.equations()
        assert not sent(basis).regrouping.flags.writeable
        np.testing.assert_array_equal(sent(model).torque_regressor(p, v, v), model.torque_regressor(p, v, v))
    reduction = reduce(space, arm, energy_error=1.0)
    assert sent(reduction).num_components == reduction.num_components


def test_controllers_before_and_after_use_tick_by_tick(arm: Mechanism) -> None:
    for controller in controllers(arm):
        for sent in WAYS:
            fresh = sent(controller)
            expected = ticks(controller, arm)
            np.testing.assert_array_equal(ticks(fresh, arm), expected)
            np.testing.assert_array_equal(ticks(sent(controller), arm), expected)


def test_plants_and_rollouts(arm: Mechanism) -> None:
    plant, pd = Plant(arm, 1e-3), PDGravity(arm, np.full(arm.dof, 100.0), np.full(arm.dof, 10.0))
    state = plant.step(plant.init(arm.neutral_configuration, np.zeros(arm.dof)), np.ones(arm.dof))
    for sent in WAYS:
        after = sent(plant).step(sent(state), np.ones(arm.dof))
        np.testing.assert_array_equal(after.q, plant.step(state, np.ones(arm.dof)).q)
    assert pd.dof == arm.dof


@pytest.mark.parametrize("name", ["adaptctl/Puma560Tracking-v0", "adaptctl/SemiDirectDriveTracking-v0"])
def test_environments_in_mid_episode(name: str) -> None:
    env = gymnasium.make(name)
    env.reset(seed=1)
    zero = np.zeros(env.action_space.shape or ())
    env.step(zero)
    copies = [env, *(sent(env) for sent in WAYS)]
    runs = [np.array([one.step(zero)[0] for _ in range(5)]) for one in copies]
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])


@pytest.mark.parametrize("name", ["adaptctl/Puma560Tracking-v0", "adaptctl/SemiDirectDriveTracking-v0"])
def test_vector_environments_in_mid_episode(name: str) -> None:
    env = gymnasium.make_vec(name, num_envs=3)
    env.reset(seed=1)
    zero = np.zeros(env.action_space.shape or ())
    env.step(zero)
    copies = [env, *(sent(env) for sent in WAYS)]
    runs = [np.array([one.step(zero)[0] for _ in range(5)]) for one in copies]
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])


def _torques(given: tuple[Controller[Any], Mechanism]) -> Array:
    return ticks(*given)


@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_other_processes_compute_the_same(method: str) -> None:
    arm = load("puma560_measured")
    pd = PDGravity(arm, np.full(arm.dof, 100.0), np.full(arm.dof, 10.0))
    expected = ticks(pd, arm)
    with multiprocessing.get_context(method).Pool(1) as pool:
        (found,) = pool.map_async(_torques, [(pd, arm)]).get(timeout=60)
    np.testing.assert_array_equal(found, expected)


class Slow:
    """A thing whose property takes a while."""

    @cached_property
    def value(self) -> int:
        """Takes a while."""
        time.sleep(0.5)
        return 1


def test_forking_while_a_thread_computes_a_property_hangs_no_child() -> None:
    """Python 3.11's own cached property holds a lock meanwhile, which the child would inherit for ever."""
    thread = threading.Thread(target=lambda: Slow().value)
    thread.start()
    time.sleep(0.1)
    child = multiprocessing.get_context("fork").Process(target=lambda: Slow().value)
    child.start()
    child.join(10.0)
    hangs = child.is_alive()
    child.kill()
    thread.join()
    assert not hangs


def test_caches_are_left_behind() -> None:
    slow = Slow()
    assert slow.value == 1
    assert "value" in vars(slow)
    for sent in WAYS:
        assert "value" not in vars(sent(slow))


class Plain:
    """Object with something to compute once."""

    def __init__(self) -> None:
        self.size = 2

    @cached_property
    def square(self) -> int:
        return self.size**2


class Stateful(Plain):
    """One that says itself what is sent of it."""

    def __getstate__(self) -> dict[str, int]:
        return {"size": self.size, "sent": 1}

    def __setstate__(self, state: dict[str, int]) -> None:
        vars(self).update(state)

    @cached_property
    def cube(self) -> int:
        return self.size**3


def test_what_was_computed_stays_behind_and_a_state_of_ones_own_is_sent() -> None:
    plain, own = Plain(), Stateful()
    assert (plain.square, own.square, own.cube) == (4, 4, 8)
    for send in (copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))):
        assert vars(send(plain)) == {"size": 2}
        assert vars(send(own)) == {"size": 2, "sent": 1}
        assert send(own).cube == 8
