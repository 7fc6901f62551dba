"""Columns of runs that are the same, in memory once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.simulation.run import Rollout


def with_shared_columns(run: Rollout, first: Rollout) -> Rollout:
    """A run with an earlier one's reference, torques that no limit changed, and estimates that stay, held once."""
    still = np.broadcast_to(run.estimate[0].copy(), run.estimate.shape)
    if np.array_equal(run.estimate, still):  # whose rows in memory have the other arrays too
        arrays = {name: x.copy() for name, x in vars(run).items() if isinstance(x, np.ndarray)}
        run = replace(run, **arrays | {"estimate": still})
    same = {name: getattr(first, name) for name in ("time", "reference_p", "reference_v", "reference_a")}
    same |= {"applied": run.torque}
    return replace(run, **{name: x for name, x in same.items() if np.array_equal(x, getattr(run, name))})
