"""Time of a tick on Python's floats."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from adaptctl.control import Controller
from adaptctl.control.memory import leaves
from adaptctl.recording import ControllerRun

FLOAT_TICKS = 20


def float_tick(controller: Controller[Any], run: ControllerRun) -> float:
    """Median time, s, in which a `controller` computes one torque on Python's floats, not compiled: over 20 states
    spread evenly over a `run`, each with the controller's initial internal state. Raises `IndexError` for a run without
    samples."""
    o, on_floats = run.rollout, controller.on_floats
    kept = leaves(controller.init(o.p[0], o.v[0]))
    costs = []
    for k in np.linspace(0, len(o.time) - 1, FLOAT_TICKS).astype(int):
        started = time.perf_counter()
        on_floats(o.p[k], o.v[k], o.reference_p[k], o.reference_v[k], o.reference_a[k], *kept)
        costs.append(time.perf_counter() - started)
    return float(np.median(costs))
