"""Periods of a control loop: their times, and that no collection of garbage is among them."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from adaptctl.hardware.timing import BINS, LoopTimes, without_collections


def test_times_of_periods_are_counted() -> None:
    times = LoopTimes(0.01)
    on_time = [times.count(0.01 * ratio) for ratio in (1.0, 1.3, 1.3, 1.1, 1.3, 0.7, 0.0, 90.0)]
    assert on_time == [True, False, False, True, False, False, False, False]
    assert (times.off, times.late, times.longest_late, times.worst) == (6, 1, 2, 0.9)
    assert times.histogram.sum() == 8
    assert times.histogram[0] == times.histogram[-1] == 1
    for ratio in (0.7, 1.1, 1.3):  # each in the bin whose edges it is between
        (place,) = np.flatnonzero((times.edges[:-1] <= 0.01 * ratio) & (0.01 * ratio < times.edges[1:]))
        assert times.histogram[place] > 0
    assert times.edges[-1] == pytest.approx(0.03)
    assert len(times.edges) == BINS + 1


def test_a_loop_collects_no_garbage_and_leaves_none_to_collect() -> None:
    for wanted in (False, True):
        (gc.enable if wanted else gc.disable)()
        left = type("Left", (), {})()
        left.itself, gone = left, weakref.ref(left)
        del left
        with without_collections():
            assert (gone(), gc.isenabled()) == (None, False)
        assert gc.isenabled() == wanted
