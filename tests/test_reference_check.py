"""References are told of, with the joint: wrong derivatives, what may be degrees, and what is beyond limits."""

from __future__ import annotations

import inspect
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import adaptctl
from adaptctl.control import MinimumJerk, Reference, ReferencePoint, Sinusoids, SlotineLi, Spline
from adaptctl.description import Joint, JointKind
from adaptctl.description.drive import Limits
from adaptctl.envs import TrackingEnv
from adaptctl.errors import ReferenceWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import simulate_many
from adaptctl.simulation.reference_limits import _may_be_degrees, _overshoots, warn_of_limits
from adaptctl.simulation.references import DIFFERENCE_STEP, warn_of_derivatives

NAMES = ("shoulder", "elbow")
TRUE = Sinusoids([0.1, 0.2], [0.5, 0.3], [0.3, 0.4])


class Twisted:
    """A reference with one of its parts changed in the second joint."""

    def __init__(self, part: str, factor: float) -> None:
        self.part, self.factor = part, factor

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        point = TRUE(t)
        return point._replace(**{self.part: getattr(point, self.part) * np.array([1.0, self.factor])})


@pytest.mark.parametrize(
    "reference",
    [
        TRUE,
        MinimumJerk([[0.0, 0.0], [1.0, 0.5], [0.0, 0.2]], [0.0, 2.0, 5.0]),
        Spline(np.sin(np.linspace(0.0, 3.0, 20))[:, None] * [1.0, 2.0], np.linspace(0.0, 5.0, 20)),
        Sinusoids([0.1, 0.2], [0.0, 0.0], [0.3, 0.4]),
    ],
)
def test_exact_derivatives_are_no_cause(reference: adaptctl.Sinusoids) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_derivatives(reference, NAMES, 5.0)


@pytest.mark.parametrize(
    ("part", "says"),
    [("a", "the acceleration of elbow is not the derivative of its velocity"), ("p", "the velocity of elbow is not")],
)
@pytest.mark.parametrize("factor", [0.0, 0.9, -1.0, 57.3])
def test_the_joint_that_is_wrong_is_named(part: str, says: str, factor: float) -> None:
    with pytest.warns(ReferenceWarning, match=says):
        warn_of_derivatives(Twisted(part, factor), NAMES, 5.0)


def test_simulations_and_environments_look() -> None:
    arm = adaptctl.load("two_link")
    law = SlotineLi(ReducedModel.full(arm), 5.0, 20.0 * np.diag(arm.mass_matrix(np.zeros(2))))
    with pytest.warns(ReferenceWarning, match="elbow"):
        simulate_many(adaptctl.Plant(arm, 1e-3), law, Twisted("a", 2.0), duration=0.5)
    with pytest.warns(ReferenceWarning, match="elbow"):
        TrackingEnv(arm, Twisted("a", 2.0), duration=0.5)


def test_a_warning_names_the_line_that_calls_the_library() -> None:
    lines, first = inspect.getsourcelines(test_a_warning_names_the_line_that_calls_the_library)
    with pytest.warns(ReferenceWarning) as told:
        warn_of_derivatives(Twisted("a", 0.0), NAMES, 5.0)
    assert [warned.filename for warned in told] == [__file__]
    assert lines[told[0].lineno - first].strip().startswith("warn_of_derivatives(")


def test_runs_that_are_too_short_for_differences_are_not_looked_at() -> None:
    def unasked(time: ArrayLike, /) -> ReferencePoint:
        raise AssertionError("the reference was asked")

    warn_of_derivatives(unasked, NAMES, 2.0 * DIFFERENCE_STEP)


def test_times_are_apart_by_the_same_and_from_both_ends_by_golden_parts_of_that() -> None:
    """So that they are neither ends nor middles of what is symmetric."""
    asked: list[np.ndarray] = []

    def watched(time: ArrayLike, /) -> ReferencePoint:
        asked.append(np.asarray(time))
        return TRUE(time)

    warn_of_derivatives(watched, NAMES, 2.0)
    before, now, after = asked
    np.testing.assert_allclose(after - now, now - before, rtol=1e-9)
    apart, gaps = np.diff(now), (before[0], 2.0 - after[-1])
    np.testing.assert_allclose(apart, [sum(gaps)] * 40, rtol=1e-9)
    assert gaps[1] / gaps[0] == pytest.approx(0.5 * (1.0 + np.sqrt(5.0)), rel=2e-3)


def drift(v: float) -> Reference:
    """A joint that stands still and states a velocity."""
    return lambda t: ReferencePoint(*(np.full((len(t), 2), x) for x in (0.3, v, 0.0)))  # type: ignore[arg-type]


def test_fast_sinusoids_and_round_off_are_no_cause() -> None:
    """Of 640 Hz; to lose more than the tolerance, differences would have to be of twice the time."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_derivatives(Sinusoids([0.0, 0.0], [1e-3, 1e-3], [640.0, 640.0]), NAMES, 5.0)
        warn_of_derivatives(Twisted("a", 0.97), NAMES, 5.0)
        warn_of_derivatives(drift(0.9e-6), NAMES, 5.0)
    with pytest.warns(ReferenceWarning, match="velocity of shoulder, elbow"):
        warn_of_derivatives(drift(1.5e-6), NAMES, 5.0)


@pytest.mark.parametrize(
    ("limits", "way", "degrees"),
    [
        ((-2.0, 2.0), (0.0, 90.0), True),  # beyond, within as degrees
        ((-2.0, 2.0), (0.0, -90.0), True),
        ((-2.0, 2.0), (0.0, 6.2), False),  # less than a turn
        ((-2.0, 2.0), (0.0, 6.3), True),
        ((-2.0, 2.0), (0.0, 115.0), False),  # beyond as degrees too
        ((-2.0, 2.0), (0.0, -115.0), False),
        ((-np.inf, np.inf), (18.84, 90.0), False),  # less than three turns at first
        ((-np.inf, np.inf), (6.0 * np.pi, 90.0), False),
        ((-np.inf, np.inf), (18.86, 0.0), True),
        ((-np.inf, np.inf), (-18.86, 0.0), True),
        ((-np.pi / 2.0, np.pi / 2.0), (0.0, 90.0), True),  # at the limit itself
        ((-np.pi / 2.0, np.pi / 2.0), (0.0, -90.0), True),
        ((-100.0, 200.0), (0.0, -100.0), False),
        ((-100.0, 200.0), (0.0, 200.0), False),
        ((-2.0, 2.0), (0.0, 2.0 * np.pi), False),
    ],
)
def test_angles_that_may_be_degrees(limits: tuple[float, float], way: tuple[float, float], degrees: bool) -> None:
    bounds = Limits(lower=limits[0], upper=limits[1])
    assert _may_be_degrees(Joint("turn", limits=bounds), np.array(way)) is degrees
    assert not _may_be_degrees(Joint("slide", JointKind.PRISMATIC, limits=bounds), np.array(way))


def test_splines_overshoot_by_a_twentieth_of_their_way_at_most() -> None:
    for beyond, told in ((0.1 + 0.9e-6, 0), (0.1 + 1.1e-6, 1)):
        spline: Any = SimpleNamespace(positions=np.array([[1.0], [3.0], [2.0]]), overshoot=np.array([beyond]))
        assert len(_overshoots(spline, [Joint("turn")])) == told


def test_each_400th_part_of_a_run_is_looked_at_with_both_ends() -> None:
    asked: list[Any] = []

    def far(t: Any) -> ReferencePoint:
        asked.append(np.asarray(t))
        p = np.full((len(t), 1), 0.1)
        return ReferencePoint(p, 2.0 * p, p)

    joint = Joint("turn", limits=Limits(velocity=0.19))
    with pytest.warns(ReferenceWarning, match=r"reference: turn moves at 0.2 rad/s, beyond 0.19$"):
        warn_of_limits(far, [joint], 8.0)
    np.testing.assert_allclose(asked[0], 0.02 * np.arange(401))
