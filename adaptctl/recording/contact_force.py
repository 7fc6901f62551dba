"""Contact forces of runs, where a plant tells them."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.controller_run import ControllerRun
from adaptctl.recording.moving_average import moving_mean
from adaptctl.simulation.mujoco_plant import TOUCH_FLAGS
from adaptctl.simulation.run import Rollout

AVERAGING_TIME = 0.05
"""s over which forces are averaged, as contacts that slide open and close from one step to the next"""


def touched(comparison: Comparison) -> list[ControllerRun]:
    """Runs with a contact."""
    return [run for run in comparison.runs if is_touched(run.rollout)]


def is_touched(rollout: Rollout) -> bool:
    """True if a run has a contact."""
    return any(rollout.flags[name].any() for name in TOUCH_FLAGS[:3] if name in rollout.flags)


def contact_forces(rollout: Rollout) -> Array:
    """Forces (T, 3) in N on the arm by what it touches, in the world's frame, averaged; zeros where none are told."""
    return moving_mean(_columns(rollout, TOUCH_FLAGS[:3]), AVERAGING_TIME, rollout.sample_time)


def contact_points(rollout: Rollout) -> Array:
    """Points (T, 3) in m at which the forces act, in the world's frame; the latest where nothing is touched."""
    closed = np.any(_columns(rollout, TOUCH_FLAGS[:3]), axis=1)
    latest = np.maximum.accumulate(np.where(closed, np.arange(len(rollout.time)), 0))
    return _columns(rollout, TOUCH_FLAGS[3:])[latest]


def _columns(rollout: Rollout, names: tuple[str, ...]) -> Array:
    nothing = np.zeros(len(rollout.time))
    return np.column_stack([rollout.flags.get(name, nothing) for name in names])
