"""Input that the design of arms refuses, each with one line that says what would be right."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from random_trees import random_chain

import adaptctl
from adaptctl.arrays import Array, random_seed
from adaptctl.control import Sinusoids
from adaptctl.description import Description, Joint, Link
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import Pose
from adaptctl.design import (
    CostMap,
    Counterweight,
    DesignTask,
    MountingBounds,
    added_mass,
    box,
    cost_map,
    cylinder,
    design_study,
    optimal_counterweights,
    point,
    simplifications,
    sphere,
)
from adaptctl.design.counterweights import _Search
from adaptctl.design.mounting_bounds import bounds
from adaptctl.design.picture import _moved
from adaptctl.design.study import _heaviest, _lifts_nothing
from adaptctl.design.task import component_counts
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NonFiniteError

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
OTHER: Any = "a"
NONE: Any = None
LISTED: Any = [1.0]
ZERO_D: Any = np.array(1.5)


@cache
def task() -> DesignTask:
    return DesignTask.within_limits(adaptctl.load("puma560_arm3"), 50)


@cache
def single() -> DesignTask:
    """An arm of one joint, whose mass matrix has nothing off the diagonal."""
    ten = from_center_of_mass(2.0, [0.3, 0.0, 0.0], 0.1 * np.eye(3))
    link = Link("arm", -1, Joint("turn", axis=np.array([0.0, 1.0, 0.0])), Pose.identity(), Pose.identity(), ten)
    return DesignTask.within_limits(Mechanism(Description("pendulum", (link,))), 50)


def test_an_arm_that_was_not_run_swings_and_a_loop_less_but_for_its_first_joint() -> None:
    for robot, sizes in (("two_link", [0.25, 0.25]), ("semi_direct_drive", [0.25, 0.125, 0.125])):
        arm = adaptctl.load(robot)
        study: Any = SimpleNamespace(task=SimpleNamespace(mechanism=arm))
        time, p = _moved(study, [])
        assert (time[0], time[-1]) == (0.0, 6.0)
        np.testing.assert_allclose(np.diff(time), 0.05)
        for j, size in enumerate(sizes):
            expected = size * np.sin(2.0 * np.pi * (j + 1) * time / 6.0)
            np.testing.assert_allclose(p[:, j] - arm.neutral_configuration[j], expected, atol=1e-12)


@pytest.mark.parametrize("size", [1.6, 9.81])
def test_a_first_axis_within_a_millionth_of_the_vertical_lifts_nothing(size: float) -> None:
    first, other = adaptctl.load("puma560_measured").links[:2]

    def idle(tilt: float) -> bool:
        return _lifts_nothing(first, size * np.array([np.sin(tilt), 0.0, -np.cos(tilt)]))

    assert (idle(0.9e-6), idle(1.1e-6)) == (True, False)
    assert not _lifts_nothing(other, size * np.array([0.0, 0.0, -1.0]))


def test_of_many_links_the_six_that_may_carry_the_heaviest_do() -> None:
    arm = random_chain(4, 8)
    every = bounds(arm, arm.description.body_names, 0.2, 0.5)
    masses = {places.link: places.mass for places in every}
    assert sorted(_heaviest(arm, every)) == sorted(sorted(masses, key=lambda link: -masses[link])[:6])
    light: Any = SimpleNamespace(link=every[-1].link, mass=0.0)
    assert _heaviest(arm, (every[-2], light)) == (every[-2].link,)
    assert _heaviest(arm, (light,)) == (light.link,)


def test_seeds_are_numbers_of_32_bits() -> None:
    assert [random_seed(seed, "seed") for seed in (0, 2**32 - 1)] == [0, 2**32 - 1]
    with pytest.raises(InputError, match="seed: expected a whole number from 0 to 4294967295, got 4294967296"):
        random_seed(2**32, "seed")


def test_places_and_grids_of_bounds_are_as_far_and_as_fine_as_told() -> None:
    box = MountingBounds("link3", np.zeros(3), np.ones(3), 1.0)
    box.validate((1.0 + 0.9e-9, 0.5, -0.9e-9))
    for far in ((1.0 + 1.5e-9, 0.5, 0.5), (0.5, 0.5, -1.5e-9)):
        with pytest.raises(InputError, match="is outside the bounds"):
            box.validate(far)
    assert box.grid(1).tolist() == [[0.0, 0.0, 0.0]]
    with pytest.raises(InputError, match="points_per_edge: expected a whole number from 1 to 100"):
        box.grid(101)


def test_the_margin_of_bounds_is_a_share_of_a_link_and_10_cm_at_least() -> None:
    arm = task().mechanism
    tight, wide = MountingBounds.for_link(arm, "link3", 0.0, 0.0), MountingBounds.for_link(arm, "link3", 1e6, 2.0)
    size = np.linalg.norm(tight.upper - tight.lower - 0.2)  # of the joints and the centre of mass
    np.testing.assert_allclose(tight.lower - wide.lower, max(2.0 * size, 0.1) - 0.1)
    assert (tight.mass, wide.mass) == (0.0, pytest.approx(1e6 * arm.links[2].inertia[0]))
    for shares in ((1.1e6, 0.0), (0.0, 1.1e6)):
        with pytest.raises(InputError, match="expected a ratio of at least 0, at most 1e\\+06"):
            MountingBounds.for_link(arm, "link3", *shares)


def test_components_that_are_zero_are_not_counted() -> None:
    sizes = np.array([[0.0, 3.0, 0.0, 4.0], [0.0, 0.0, 0.0, 0.0]])
    for percent, counts in ((0.0, [2, 0]), (59.0, [2, 0]), (61.0, [1, 0]), (100.0, [0, 0])):
        assert component_counts(sizes, percent).tolist() == counts


def test_slopes_of_the_search_are_differences_of_its_residuals() -> None:
    search, z = _Search(task(), (third(),), "energy", 7850.0), np.array([0.4, 0.3, 0.6, 0.7])
    slopes = search.slopes(z)
    for k, step in enumerate(1e-6 * np.eye(4)):
        change = (search.residuals(z + step) - search.residuals(z - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, k], change, atol=1e-6 * np.abs(slopes).max())


def test_the_ten_best_of_the_designs_that_are_drawn_are_improved(monkeypatch: pytest.MonkeyPatch) -> None:
    search, starts = _Search(task(), (third(),), "energy", 7850.0), []
    monkeypatch.setattr(
        "scipy.optimize.least_squares", lambda f, z, *a, **more: starts.append(z) or SimpleNamespace(x=z, cost=0.0)
    )
    drawn = search.drawn(0)
    assert len(drawn) == 1 + 4096
    search.least(None, 0)
    assert search.evaluations == len(drawn)
    costs = np.sort(np.linalg.norm(search.residuals(drawn), axis=-1))
    np.testing.assert_allclose([np.linalg.norm(search.residuals(z)) for z in starts], costs[:10])


def test_a_search_begins_without_counterweights_in_the_middle_of_their_places() -> None:
    search = _Search(task(), (third(),), "energy", 7850.0)
    masses, places = search.physical(search.drawn(0)[0])
    assert masses.tolist() == [0.0]
    np.testing.assert_allclose(places, [0.5 * (third().lower + third().upper)])


@cache
def third() -> MountingBounds:
    return MountingBounds.for_link(task().mechanism, "link3")


def several() -> Array:
    return np.stack([task().parameters, task().parameters])


def with_states(count: int) -> DesignTask:
    return DesignTask(task().mechanism, task().p[:count], task().v[:count], task().a[:count], "")


def along_sinusoids(duration: float, samples: int) -> DesignTask:
    swing = Sinusoids(np.zeros(3), np.full(3, 0.4), np.full(3, 0.1))
    return DesignTask.from_reference(task().mechanism, swing, duration, samples)


def test_a_task_keeps_its_own_states() -> None:
    given = task().p.copy()
    made = DesignTask(task().mechanism, given, task().v.tolist(), task().a, "")
    given[:] = 0.0
    np.testing.assert_array_equal(made.p, task().p)
    np.testing.assert_array_equal(made.v, task().v)
    assert not made.p.flags.writeable


WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "seed -1": (lambda: optimal_counterweights(task(), [third()], seed=-1), "seed: expected a whole number from 0"),
    "seed text": (lambda: optimal_counterweights(task(), [third()], seed=OTHER), "seed: expected a whole number"),
    "seed none": (lambda: optimal_counterweights(task(), [third()], seed=NONE), "seed: expected a whole number"),
    "study's seed": (lambda: design_study(task(), seed=-1), "seed: expected a whole number from 0"),
    "expected at least one state": (
        lambda: with_states(0),
        "expected one shape (samples, 3), at least 2 samples, got (0, 3)",
    ),
    "one state": (lambda: with_states(1), "expected one shape (samples, 3), at least 2 samples, got (1, 3)"),
    "stack": (lambda: task().cost("energy", several()), "parameters: expected shape (30,), got (2, 30)"),
    "stack's torques": (lambda: task().torques(several()), "parameters: expected shape (30,), got (2, 30)"),
    "speed": (
        lambda: DesignTask.within_limits(task().mechanism, 50, speed=1e200),
        "speed: expected a finite number of at least 0, at most 1e+100",
    ),
    "reference's samples": (lambda: along_sinusoids(1.0, 1), "task: samples: expected a whole number from 2"),
    "reference's duration": (lambda: along_sinusoids(-1.0, 10), "task: duration: expected a positive number of s"),
    "percent text": (lambda: task().components(OTHER), "percent: expected a number, got 'a'"),
    "percent none": (lambda: task().components(NONE), "percent: expected a number, got None"),
    "percent nan": (lambda: task().components(np.nan), "percent: expected a finite number of at least 0"),
    "mass's percent": (lambda: added_mass(task(), "link3", 1.0, percent=OTHER), "percent: expected a number"),
    "balls' percent": (lambda: optimal_counterweights(task(), [third()], percent=OTHER), "percent: expected a number"),
    "objective": (
        lambda: task().cost_matrix(LISTED),
        "objective: expected one of energy, torque, coupling, components",
    ),
    "cost's objective": (lambda: task().cost("beauty"), "objective: expected one of energy, torque, coupling"),
    "map's mass": (lambda: cost_map(task(), -1.0), "mass: expected a positive number of kg, got -1"),
    "map's nan": (lambda: CostMap(task(), np.nan, "energy"), "mass: expected a positive number of kg, got nan"),
    "map's objective": (lambda: cost_map(task(), 1.0, LISTED), "objective: expected one of energy"),
    "no cost": (lambda: cost_map(single(), 1.0, "coupling"), "objective: 'coupling' is zero in all states"),
    "sphere": (lambda: sphere(LISTED), "mass: expected a number, got [1.0]"),
    "heavy sphere": (lambda: sphere(1e300), "mass: expected a number of at least 0 kg and at most 1e+20"),
    "thin sphere": (lambda: sphere(1.0, density=1e-320), "density: expected a number above 0, from 1e-100"),
    "box": (lambda: box(LISTED, (1.0, 1.0, 1.0)), "mass: expected a number, got [1.0]"),
    "cylinder": (lambda: cylinder(1.0, LISTED, 1.0), "radius: expected a number, got [1.0]"),
    "wide": (lambda: cylinder(1.0, 1e200, 1.0), "radius: expected a number above 0, from 1e-100 to 1e+100"),
    "long": (lambda: cylinder(1.0, 1.0, 1e200), "length: expected a number above 0, from 1e-100 to 1e+100"),
    "bounds' mass": (
        lambda: MountingBounds("link3", np.zeros(3), np.ones(3), OTHER),
        "link3: mass: expected a number, got 'a'",
    ),
    "share": (
        lambda: MountingBounds.for_link(task().mechanism, "link3", OTHER),
        "mounting bounds: mass_ratio: expected a number, got 'a'",
    ),
    "beyond": (
        lambda: MountingBounds.for_link(task().mechanism, "link3", 0.2, OTHER),
        "mounting bounds: max_offset: expected a number",
    ),
    "twice": (
        lambda: simplifications(task(), [third(), third()]),
        "expected bounds for different links, got link3, link3",
    ),
    "link": (
        lambda: simplifications(task(), [MountingBounds("x", np.zeros(3), np.ones(3), 1.0)]),
        "no link 'x' with inertia; links: link1, link2, link3",
    ),
    "ball's mass": (lambda: Counterweight("x", -1.0, np.zeros(3), 7850.0), "mass: expected a number of at least 0 kg"),
    "ball's place": (lambda: Counterweight("x", 1.0, np.zeros(2), 7850.0), "place: expected shape (3,), got (2,)"),
    "ball's density": (lambda: Counterweight("x", 1.0, np.zeros(3), np.nan), "density: expected a number above 0"),
    "far": (lambda: added_mass(task(), "link3", 1.0, (1e150, 0.0, 0.0)), "expected inertial parameters of at most"),
}
TOO_LARGE: dict[str, tuple[Callable[[], object], str]] = {
    "cost": (lambda: task().cost("energy", task().parameters * 1e300), "parameters: the cost overflows"),
    "torques": (lambda: task().torques(task().parameters * 1e300), "parameters: the cost overflows"),
    "components": (lambda: task().components(1.0, task().parameters * 1e300), "parameters: the cost overflows"),
    "weights": (lambda: task().energy_fractions(task().parameters * 1e300), "parameters: the cost overflows"),
    "place": (lambda: cost_map(task()).at("link3", (1e200, 0.0, 0.0)), "link3: positions: expected smaller distances"),
}


@pytest.mark.parametrize("case", sorted(WRONG))
def test_wrong_input_is_refused(case: str) -> None:
    call, told = WRONG[case]
    with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
        call()
    assert told in str(caught.value)


@pytest.mark.parametrize("case", sorted(TOO_LARGE))
def test_numbers_that_overflow_are_refused(case: str) -> None:
    call, told = TOO_LARGE[case]
    with pytest.raises(NonFiniteError, match=r"^[^\n]*$") as caught:
        call()
    assert told in str(caught.value)


@pytest.mark.parametrize(
    "body", [point, sphere, lambda mass: box(mass, (0.1, 0.1, 0.1)), lambda mass: cylinder(mass, 0.1, 0.1)]
)
def test_a_mass_may_be_an_array_of_no_axes(body: Callable[[Any], Any]) -> None:
    assert body(ZERO_D).mass == 1.5
    assert added_mass(task(), "link3", ZERO_D).body.mass == 1.5
    assert cost_map(task(), ZERO_D).mass == 1.5


def test_a_percentage_may_be_any_number_from_zero() -> None:
    assert task().components(0.0) == task().essential_space.rank
    assert task().components(1e300) == task().components(100.0) == 0


def test_what_is_kept_is_read_only() -> None:
    added = added_mass(task(), "link3", 1.0)
    ball = Counterweight("link3", 1.0, np.zeros(3), 7850.0)
    balanced = optimal_counterweights(task(), [third()])
    kept = [added.parameter_change, added.parameters, added.essential_change, balanced.parameters, ball.place]
    kept += [
        task().torque_limits,
        *(task().cost_matrix(name) for name in ("energy", "torque", "coupling", "components")),
    ]
    assert not any(array.flags.writeable for array in kept)
    assert not pickle.loads(pickle.dumps(ball)).place.flags.writeable
