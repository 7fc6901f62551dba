"""Levels above which a missed torque raises a doubt."""

from __future__ import annotations

from typing import Any

import pytest

from adaptctl.control.adaptation.doubt import CONTACT, PAYLOAD, UNKNOWN, TorqueEquations, Watch, calm, doubted, ended
from adaptctl.control.adaptation.law import Period
from adaptctl.scalars import Column


def doubts(
    miss: float, noise: float = 0.0, form: float = 2.0, counts: float = 1.0, onwards: float = 1.0, friction: float = 0.0
) -> bool:
    """Whether a miss of one joint raises a doubt after 8 s, in units of the stated error."""
    zero, one = Column((0.0,)), Column((1.0,))
    watch = Watch(zero, Column((noise,)), zero, one, Column((8.0,)), zero, zero, zero)
    whether = Column((counts,)), Column((onwards,))
    sample = TorqueEquations([], [], zero, Column((miss,)), one, *whether, one)
    period: Any = Period(None, *4 * [zero], zero, 1e-3, 1e-3, one)  # type: ignore[arg-type]
    return float(doubted(sample, Column((form,)), period, watch, Column((friction,)))[1][0]) > 0.0


def test_a_doubt_is_raised_by_what_is_no_noise_and_was_shown_before() -> None:
    assert doubts(2.5)  # a light load, as long as nothing was missed before
    assert not doubts(1.7)
    assert not doubts(5.0, noise=1.0)
    assert doubts(7.0, noise=1.0)
    assert not doubts(60.0, form=700.0)  # of a direction that is excited for the first time
    assert not doubts(8.0, onwards=0.0)  # the sign of friction, while a joint turns back
    assert doubts(13.0, onwards=0.0)
    assert not doubts(13.0, onwards=0.0, friction=5.0)  # learned friction whose sign may be wrong
    assert doubts(13.0, friction=5.0)


def test_a_memory_is_as_calm_as_its_loudest_joint() -> None:
    weights = Column((4.0, 100.0))  # standard deviations of 0.5 and 0.1 are stated
    assert calm(Column((0.0, 0.0)), weights) == 1.0
    assert calm(Column((0.125, 0.0001)), weights) == pytest.approx(0.5)
    assert calm(Column((0.125, 0.0075)), weights) == pytest.approx(0.25)
    assert calm(Column((1.0, 0.0)), weights) == 0.0


@pytest.mark.parametrize(
    ("alarm", "doubt", "payload", "decision", "after"),
    [
        (0.0, 0.0, 0.0, UNKNOWN, (0.0, 0.0, 0.0)),
        (0.0, 1.0, 0.0, UNKNOWN, (0.5, 0.0, 0.0)),  # it begins
        (0.5, 1.0, 0.0, UNKNOWN, (1.0, 0.0, 0.0)),
        (0.5, 0.0, 0.0, UNKNOWN, (0.0, 1.0, 0.0)),  # it is cleared
        (1.5, 1.0, 0.0, UNKNOWN, (2.0, 0.0, 0.0)),  # it may last 2 s
        (1.75, 1.0, 0.0, UNKNOWN, (0.0, 0.0, 1.0)),
        (1.75, 1.0, 1.0, UNKNOWN, (0.5, 0.0, 0.0)),  # a payload begins it anew
        (1.75, 1.0, 0.0, PAYLOAD, (0.0, 0.0, 1.0)),
        (1.75, 1.0, 0.0, CONTACT, (1.8, 0.0, 0.0)),  # of a contact only a tenth of the time counts
    ],
)
def test_an_alarm_begins_goes_on_and_ends(
    alarm: float, doubt: float, payload: float, decision: float, after: tuple[float, float, float]
) -> None:
    watch = Watch(*5 * [None], Column((alarm,)), None, Column((decision,)))
    found = ended(watch, Column((0.0, doubt)), payload, 2.0, 0.5)
    assert tuple(map(float, found)) == pytest.approx(after)
