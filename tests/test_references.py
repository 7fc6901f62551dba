"""References: exact derivatives, smooth starts, rest at the ends."""

from __future__ import annotations

import itertools
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.compilation import compile_function
from adaptctl.control import MinimumJerk, Reference, ReferencePoint, Sinusoids, Spline
from adaptctl.control.references import SinusoidNumbers, sinusoids_at
from adaptctl.control.transitions import FadeIn, StoppedReference
from adaptctl.errors import InputError
from adaptctl.scalars import Column

TEXT, RAGGED = cast(Any, "a"), cast(Any, ((0.0,), (1.0, 2.0)))

sinusoids = st.builds(
    Sinusoids,
    center=st.just((0.1, -0.2)),
    amplitude=st.tuples(st.floats(0.1, 1.0), st.floats(0.1, 1.0)),
    frequency=st.tuples(st.floats(0.05, 2.0), st.floats(0.05, 2.0)),
    phase=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    start_time=st.sampled_from([0.0, 0.5, 2.0]),
)
jerks = st.builds(
    MinimumJerk,
    waypoints=st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=3, max_size=3),
    times=st.just((0.5, 2.0, 3.5)),
)
faded = st.builds(
    FadeIn, st.one_of(sinusoids, jerks), st.tuples(st.floats(-2, 2), st.floats(-2, 2)), st.sampled_from([0.5, 2.0])
)


@settings(max_examples=20, deadline=None)
@given(faded, st.floats(0.0, 5.0))
def test_a_reference_fades_in_from_rest_where_the_arm_stands(reference: FadeIn, t: float) -> None:
    for time in (-1.0, 0.0):
        point = reference(time)
        np.testing.assert_allclose(point.p, reference.start, rtol=1e-15)
        np.testing.assert_array_equal([point.v, point.a], 0.0)
    for own, other in zip(reference(reference.duration + t), reference.reference(reference.duration + t), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-12)
    own, other, way = reference(t), reference.reference(t), np.abs(reference.reference(t).p - reference.start)
    low, high = np.sort([reference.start, other.p], axis=0)
    assert np.all((low - 1e-12 <= own.p) & (own.p <= high + 1e-12))
    assert np.all(np.abs(own.v) <= 1.875 / reference.duration * way + np.abs(other.v) + 1e-12)


@settings(max_examples=30, deadline=None)
@given(st.one_of(sinusoids, jerks, faded), st.floats(0.0, 5.0))
def test_velocity_and_acceleration_are_derivatives(reference: Reference, t: float) -> None:
    h = 1e-4
    before, now, after = reference(t - h), reference(t), reference(t + h)
    np.testing.assert_allclose((after.p - before.p) / (2 * h), now.v, atol=2e-3)
    np.testing.assert_allclose((after.v - before.v) / (2 * h), now.a, atol=5e-1)
    inside = min(abs(t - joint) for joint in (0.0, 0.5, 2.0, 3.5)) > 2 * h
    if inside:
        np.testing.assert_allclose((after.v - before.v) / (2 * h), now.a, atol=1e-4 * (1 + np.abs(now.a).max()))


@settings(max_examples=20, deadline=None)
@given(st.one_of(sinusoids, jerks, faded))
def test_many_times_at_once_are_each_time(reference: Reference) -> None:
    times = np.linspace(-0.5, 5.0, 12).reshape(3, 4)
    together = reference(times)
    assert together.p.shape == (3, 4, 2)
    for index in np.ndindex(3, 4):
        for many, one in zip(together, reference(times[index]), strict=True):
            np.testing.assert_allclose(many[index], one, rtol=1e-13, atol=1e-13)


@settings(max_examples=20, deadline=None)
@given(sinusoids.filter(lambda s: s.start_time > 0))
def test_a_faded_start_is_at_rest_in_the_centre(reference: Sinusoids) -> None:
    start = reference(0.0)
    np.testing.assert_array_equal(start.p, reference.center)
    assert not np.any(start.v)
    assert not np.any(start.a)


def test_sums_of_sinusoids_are_sums() -> None:
    one = Sinusoids((0.0,), (0.3,), (0.5,), start_time=0.0)
    two = Sinusoids((0.0,), (0.2,), (1.5,), (0.7,), start_time=0.0)
    both = Sinusoids((0.0,), ((0.3,), (0.2,)), ((0.5,), (1.5,)), ((0.0,), (0.7,)), start_time=0.0)
    for sum_, a, b in zip(both(1.3), one(1.3), two(1.3), strict=True):
        np.testing.assert_allclose(sum_, a + b, atol=1e-14)


def test_minimum_jerk_rests_at_its_waypoints() -> None:
    waypoints = ((0.0, 1.0), (1.0, 0.5), (0.2, -1.0))
    reference = MinimumJerk(waypoints, (0.0, 1.0, 2.5))
    for p, t in zip(waypoints, (0.0, 1.0, 2.5), strict=True):
        now = reference(t)
        np.testing.assert_allclose(now.p, p, atol=1e-14)
        np.testing.assert_allclose([now.v, now.a], 0.0, atol=1e-12)
    np.testing.assert_allclose(reference(9.0).p, waypoints[-1], atol=1e-14)


def test_a_spline_rests_before_its_first_time_and_after_its_last() -> None:
    """Its samples move there, so that its own derivatives do not rest."""
    times = np.linspace(1.0, 3.0, 9)
    positions = np.stack([times**2, np.sin(2.0 * times)], axis=-1)
    spline = Spline(positions, times)
    for t, end in ((-1.0, 0), (0.999, 0), (3.001, -1), (50.0, -1)):
        outside = spline(t)
        np.testing.assert_allclose(outside.p, positions[end], atol=1e-12)
        np.testing.assert_array_equal([outside.v, outside.a], 0.0)
    inside = spline(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(inside.v[:, 0], [2.0, 4.0, 6.0], atol=1e-9)
    np.testing.assert_allclose(inside.a[:, 0], 2.0, atol=1e-8)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Sinusoids((0.0, 0.0), (1.0,), (1.0, 1.0)), r"amplitude: expected shape \(1, 2\), got \(1, 1\)"),
        (lambda: Sinusoids((0.0,), (np.nan,), (1.0,)), "amplitude: expected finite"),
        (lambda: Sinusoids((0.0,), (1.0,), (1.0,), start_time=-1.0), "start_time"),
        (lambda: Sinusoids(TEXT, (1.0,), (1.0,)), "center: expected numbers, got 'a'"),
        (lambda: Sinusoids((0.0,), TEXT, (1.0,)), "amplitude: expected numbers, got 'a'"),
        (lambda: Sinusoids((0.0,), (1.0,), TEXT), "frequency: expected numbers, got 'a'"),
        (lambda: Sinusoids((0.0,), (1.0,), (1.0,), TEXT), "phase: expected numbers, got 'a'"),
        (lambda: Sinusoids((0.0,), RAGGED, (1.0,)), "amplitude: expected numbers, got "),
        (lambda: Sinusoids((0.0,), (1.0,), (1.0,), RAGGED), "phase: expected numbers, got "),
        (lambda: Sinusoids((0.0,), (1.0,), (1.0,), start_time=TEXT), "start_time: expected a number, got 'a'"),
        (lambda: Spline(TEXT, (0.0,)), "positions: expected numbers, got 'a'"),
        (lambda: Spline([0.0, 1.0], np.zeros((2, 2))), r"Spline\(positions, times\), in this order"),
        (lambda: MinimumJerk(TEXT, (0.0,)), "waypoints: expected numbers, got 'a'"),
        (lambda: MinimumJerk(RAGGED, (0.0, 1.0)), "waypoints: expected numbers, got "),
        (
            lambda: StoppedReference(MinimumJerk(((0.0,), (1.0,)), (0.0, 1.0)), TEXT),
            "stopped reference: stop: expected a number, got 'a'",
        ),
        (lambda: FadeIn(TEXT, (0.0,)), "fade in: expected a reference, a function of time, got 'a'"),
        (lambda: FadeIn(Sinusoids((0.0,), (1.0,), (1.0,)), (0.0, 1.0)), r"start: expected shape \(1,\), got \(2,\)"),
        (lambda: FadeIn(Sinusoids((0.0,), (1.0,), (1.0,)), (np.nan,)), "start: expected finite"),
        (
            lambda: FadeIn(Sinusoids((0.0,), (1.0,), (1.0,)), (0.0,), 0.0),
            "fade in: duration: expected a positive",
        ),
        (lambda: FadeIn(Sinusoids((0.0,), (1.0,), (1.0,)), (0.0,), TEXT), "fade in: duration: expected a positive"),
        (lambda: MinimumJerk(((0.0,),), (0.0,)), "at least two waypoints"),
        (lambda: MinimumJerk(((0.0,), (1.0,)), (1.0, 1.0)), "increasing times"),
    ],
)
def test_bad_references_are_refused(make: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()  # type: ignore[operator]


def test_each_of_many_arms_follows_sinusoids_of_its_own_numbers() -> None:
    rng = np.random.default_rng(0)
    references = [
        Sinusoids(rng.normal(size=2), *rng.uniform(0.1, 1.0, (3, 3, 2)), start_time=start) for start in (0.0, 0.5, 2.0)
    ]
    sizes = {name: len(values) for name, values in references[0].numbers._asdict().items()}

    def point(time: Column, **numbers: Column) -> ReferencePoint:
        return sinusoids_at(time[0], SinusoidNumbers(**numbers))

    kernel = compile_function(point, {"time": 1} | sizes)
    for reference, t in itertools.product(references, (0.0, 0.3, 0.5, 7.0)):
        native, arrays = kernel([t], *reference.numbers), reference(t)
        floats = point(Column((t,)), **{name: Column(x.tolist()) for name, x in reference.numbers._asdict().items()})
        for got, one, expected in zip(native, floats, arrays, strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(one.of, expected, rtol=1e-12, atol=1e-12)
