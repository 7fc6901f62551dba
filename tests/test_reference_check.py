"""References whose derivatives are wrong are told, with the joint; those of the library never are."""

from __future__ import annotations

import inspect
import warnings

import numpy as np
import pytest
from numpy.typing import ArrayLike

import adaptctl
from adaptctl.control import MinimumJerk, ReferencePoint, Sinusoids, SlotineLi, Spline
from adaptctl.envs import TrackingEnv
from adaptctl.errors import ReferenceWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import simulate_many
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
@pytest.mark.parametrize("factor", [0.0, 0.8, -1.0, 57.3])
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
