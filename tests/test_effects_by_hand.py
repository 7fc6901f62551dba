"""Limits and small parts of effects and plants, on both sides of what decides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import PAIR, on

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import InputError, NotFoundError
from adaptctl.identifiability import Constraints, Relation, constrained
from adaptctl.scalars import Column
from adaptctl.simulation import LinearlyImplicitEuler, Plant
from adaptctl.simulation.closed_loop import not_compiled
from adaptctl.simulation.effects import (
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    JointEffect,
    LuGre,
    Payload,
    PayloadHeld,
)
from adaptctl.simulation.rollout import KeptSamples


def test_an_encoder_counts_to_the_nearest_step() -> None:
    p = Column([0.49, 0.51, -0.51, 3.2, -7.7, 2.0**50 + 1.3, 2.0**51 - 1.0])
    read, *_ = Encoder(1.0).measure(p, p, Column.zeros(2 * len(p)), Column(()), 1e-3)
    assert list(read) == [round(x) for x in p]


def test_the_finest_step_of_an_encoder_is_a_picometre() -> None:
    for step, fits in ((0.0, True), (1e-12, True), (1.5e-12, True), (0.99e-12, False)):
        encoder = Encoder(resolution=step)
        if fits:
            encoder.validate(1, (), 1e-3)
        else:
            with pytest.raises(InputError, match="resolution: expected 0 or at least"):
                encoder.validate(1, (), 1e-3)


def test_differences_are_filtered_below_half_of_the_sampling_rate() -> None:
    FilteredDifferences(499.9).validate(1, (), 1e-3)
    with pytest.raises(InputError, match="a cutoff of 500 Hz is not below half the sampling rate, 500 Hz"):
        FilteredDifferences(500.0).validate(1, (), 1e-3)


@pytest.mark.parametrize(
    ("tensor", "is_one"),
    [
        (np.diag([1.0, 1.0, 2.0]), True),  # flat
        (np.diag([1.0, 1.0, 2.0 + 7e-12]), True),
        (np.diag([1.0, 1.0, 2.0 + 13e-12]), False),
        (np.diag([2.0, 1.5, 1.0]) + 0.9e-9 * np.triu(np.ones((3, 3)), 1) * 2.0, True),
        (np.diag([2.0, 1.5, 1.0]) + 1.2e-9 * np.triu(np.ones((3, 3)), 1) * 2.0, False),
        (np.diag([0.5, 0.5, 0.5]), True),
    ],
)
def test_an_inertia_is_symmetric_and_of_masses_above_zero_but_for_round_off(tensor: Any, is_one: bool) -> None:
    if is_one:
        np.testing.assert_allclose(Payload(1.0, inertia=tensor).inertia, 0.5 * (tensor + tensor.T))
    else:
        with pytest.raises(InputError, match="is not that of a body"):
            Payload(1.0, inertia=tensor)


def test_a_payload_is_added_to_a_link_that_there_is() -> None:
    body, own = Payload(2.0, [0.1, 0.2, 0.3]), np.ones((4, 20))
    loaded = body.added_to(own, 1)
    np.testing.assert_array_equal(loaded[:, :10], 1.0)
    ten = from_center_of_mass(2.0, [0.1, 0.2, 0.3], np.zeros((3, 3)))
    np.testing.assert_allclose(loaded[:, 10:], [1.0 + ten] * 4)
    for link, parameters in ((2, own), (-1, own), (0, np.ones(9)), (0, 3.0)):
        with pytest.raises(InputError, match="payload: link"):
            body.added_to(parameters, link)


def test_a_payload_is_held_from_its_start_to_before_its_stop() -> None:
    held = PayloadHeld(2.0, start=1.0, stop=3.0)
    times = (0.99, 1.0, 2.99, 3.0)
    assert [held.mass(time) for time in times] == [0.0, 2.0, 2.0, 0.0]
    assert [held.loaded(np.zeros(10), ("a",), time)[0] for time in times] == [0.0, 2.0, 2.0, 0.0]
    assert [held.next_change_time(time) for time in times] == [1.0, 3.0, 3.0, np.inf]
    for start, stop in ((1.0, 1.0), (-np.inf, 2.0), (3.0, 2.0)):
        with pytest.raises(InputError, match="a start before its stop"):
            PayloadHeld(2.0, start=start, stop=stop)
    PayloadHeld(2.0, link="a").validate(1, ("a", "b"), 1e-3)
    with pytest.raises(NotFoundError, match="payload: unknown link 'c'; links: a, b"):
        PayloadHeld(2.0, link="c").validate(1, ("a", "b"), 1e-3)


def test_a_period_has_a_million_steps_at_most() -> None:
    assert Plant(PAIR.mechanism, 1e-3, 10**6).substeps == 10**6
    with pytest.raises(InputError, match="substeps"):
        Plant(PAIR.mechanism, 1e-3, 10**6 + 1)


def test_a_payload_needs_a_mechanism_whose_parameters_are_free() -> None:
    relation = Relation({PAIR.mechanism.parameter_names[0]: 1.0}, 0.5)
    bound = constrained(PAIR.mechanism, Constraints(relations=(relation,)))
    Plant(bound, 1e-3)
    with pytest.raises(InputError, match="has relations among its parameters, which a payload"):
        Plant(bound, 1e-3, effects=[PayloadHeld(1.0)])


def test_as_many_links_as_can_be_are_compiled() -> None:
    plant = Plant.__new__(Plant)
    for links, told in ((MAX_COMPILED_LINKS, ""), (MAX_COMPILED_LINKS + 1, "101 links are too many to compile")):
        object.__setattr__(plant, "mechanism", SimpleNamespace(links=range(links)))
        assert not_compiled(plant, on(PAIR, None)) == told


def test_encoders_of_motors_read_these_behind_friction_with_a_state() -> None:
    effects = [LuGre(0.5, 1e4), ElasticJoints(1e4, damping=1.0, motor_inertia=0.1, encoders="motor")]
    plant = Plant(PAIR.mechanism, 1e-3, 4, LinearlyImplicitEuler(), effects=effects)
    after = plant.step(plant.init([0.1, 0.2], [0.3, 0.4]), [5.0, -3.0])
    bristles, theta, w = np.split(after.drives, 3)
    np.testing.assert_array_equal([*after.measured_p, *after.measured_v], [*theta, *w])
    assert np.all(np.abs(bristles) < 1e-3)
    assert np.all(theta != after.p)


class Steady(JointEffect):
    """The same torque at all speeds."""

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        pass

    def torque(self, v: Column, held: Column) -> Column:
        return Column([3.0] * len(v))

    def max_slope(self, dof: int) -> Array:
        return np.full(dof, np.inf)


def test_friction_is_a_slope_through_its_torque_and_at_rest_that_at_a_nanometre_per_second() -> None:
    speeds = [2.0, 1.5e-9, 0.0]
    fixed, slopes = Steady().resistance(Column(()), Column(speeds), Column([0.0] * 3), 1e-3)
    assert list(fixed) == [0.0] * 3
    assert list(slopes) == pytest.approx([1.5, 2e9, 3e9])
    assert Steady().moved_state(Column([7.0]), Column([1.0]), 1e-3)[0] == 7.0


def test_samples_of_the_longest_time_are_all_kept() -> None:
    kept = KeptSamples.of(2, 1e300, 1e-3)
    assert kept.rows(0, 5).tolist() == [0, 1, 2]
    assert kept.room(5) == 3
