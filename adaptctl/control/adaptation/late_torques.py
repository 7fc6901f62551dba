"""Torques that arrive some control periods late."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.scalars import Column

MAX_DELAY = 64
"""control periods"""


class SentTorques(NamedTuple):
    """Torques (d r,) in N m (N) that were sent in d control periods and have not arrived, the oldest first."""

    torques: Any


def start(delay: int, r: int) -> Any:
    """State of a delay in control periods: no torque is on its way."""
    return SentTorques(np.zeros(delay * r)) if delay else NoMemory()


def arrived(period: Period, sent: Any) -> tuple[Period, Any]:
    """Period with the torque that acted in it, and what is on its way after it."""
    if not isinstance(sent, SentTorques):
        return period, sent
    r = len(period.torque)
    after = SentTorques(Column((*sent.torques[r:], *period.torque)))
    return period._replace(torque=Column(sent.torques[:r])), after
