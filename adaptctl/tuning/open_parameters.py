"""Parameters that a reference hardly shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.excitation.torque_uncertainty import NUM_SAMPLES, OPEN_SHARE, torque_uncertainty
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.default_gains import HORIZON

MOST_NAMES = 6


class FollowedExactly(NamedTuple):
    """Run (T, r) without errors, and the time between its samples in s."""

    p: Array
    v: Array
    reference_p: Array
    reference_v: Array
    reference_a: Array
    sample_time: float


def open_note(model: ReducedModel, reference: Reference, limits: Array) -> str:
    """Sentence on the parameters that a reference hardly shows within 20 s; or empty."""
    times = np.linspace(0.0, HORIZON, NUM_SAMPLES)
    p, v, a = reference(times)
    found = torque_uncertainty(model, FollowedExactly(p, v, p, v, a, float(times[1])), limits)
    names = [name for name, share in zip(model.names, found, strict=True) if share > OPEN_SHARE]
    if not names:
        return ""
    shown = ", ".join((*names[:MOST_NAMES], *["..."][: len(names) - MOST_NAMES]))
    return (
        f"in {HORIZON:g} s this reference hardly shows {len(names)} of {len(model.names)} parameters: {shown}; their "
        "torques may be wrong on other motions: move all joints, farther, at different frequencies"
    )
