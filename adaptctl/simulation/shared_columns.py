"""Columns of runs that are the same, in memory once."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from adaptctl.simulation.run import Rollout

REFERENCE = "time", "reference_p", "reference_v", "reference_a"


def with_shared_columns(run: Rollout, first: Rollout) -> Rollout:
    """A run with an earlier one's reference, torques that no limit changed, and estimates that stay, held once."""
    shared = {name: getattr(first, name) for name in REFERENCE}
    shared["estimate"] = np.broadcast_to(run.estimate[0].copy(), run.estimate.shape)
    same = {name: x for name, x in shared.items() if np.array_equal(x, getattr(run, name))}
    # Copies, since rows in the memory of a run have what is shared, and what it does not give, too.
    values = {field.name: getattr(run, field.name) for field in fields(run) if field.name not in same}
    own = {name: x.copy() for name, x in values.items() if isinstance(x, np.ndarray)}
    if np.array_equal(run.applied, run.torque):
        own["applied"] = own["torque"]
    return replace(run, **same | own)
