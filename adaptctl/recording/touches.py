"""Touches of runs, where the law tells external torques."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.recording.controller_run import ControllerRun

CALM = 1.0
"""s without a touch after which the next is another"""


class TouchSpan(NamedTuple):
    """Touch from its begin to its end in s, with the joint that felt most at its begin, in N m (N)."""

    start: float
    end: float
    joint: str
    torque: float


def touches(run: ControllerRun, names: Sequence[str]) -> list[TouchSpan]:
    """Touches of a run, in which a joint's external torque was above its level; none where no law tells it."""
    time, told, r = run.rollout.time, run.rollout.logged_state, len(names)
    if "GuardedLearning" not in run.law or told.shape[1] != 1 + 2 * r:
        return []
    torque, over = told[:, 1 : 1 + r], np.abs(told[:, 1 : 1 + r]) - told[:, 1 + r :]
    above = np.flatnonzero((over > 0.0).any(axis=1))
    spans = np.split(above, np.flatnonzero(np.diff(time[above]) > CALM) + 1) if len(above) else []
    most = [(span, int(np.argmax(over[span[0]]))) for span in spans]
    return [TouchSpan(float(time[i[0]]), float(time[i[-1]]), names[j], float(torque[i[0], j])) for i, j in most]
