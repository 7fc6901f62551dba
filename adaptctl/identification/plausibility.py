"""Checks of what a log cannot be: friction that drives, and equations that explain nothing."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.least_squares import least_squares, weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations

DRIVING = -0.3
"""Power of friction over the product of root mean square torque and speed, below which a sign must be wrong."""
NEEDED = 1.5
"""Squares without a joint's friction over those with it, from where on friction is seen."""
UNEXPLAINED = 0.5
"""Share of the torques that least squares may leave of its own rows."""


def require_plausible(evidence: LogEvidence, source: str, cutoff: float) -> None:
    """Raise `InputError` where logs cannot be of their robot: where least squares finds friction that drives a joint's
    motion, so that a sign must be wrong, or where its residuals are more than half of the torques, as root mean squares
    over all joints. Friction drives where its mean power is below -0.3 times the product of the joint's root mean
    square torque and speed, and without the joint's friction the sum of squared weighted residuals is more than 1.5
    times as large; the message names the joint. `evidence` holds the logs' filtered equations, of which those at a
    low-pass filter's `cutoff` (Hz) are used; `source` names the log in the message. Raises `KeyError` for a cut-off
    that the evidence does not have."""
    friction = FrictionModel()
    equations = evidence.equations(cutoff, range(evidence.blocks))
    x, deviations = weighted_least_squares(equations, evidence.independent(friction))
    left = float(np.sqrt(equations.misfit(x).sum() / equations.square.sum()))
    values = dict(zip(evidence.mechanism.parameter_names, x.tolist(), strict=False))
    rows = evidence.rows[cutoff]
    for j, joint in enumerate(evidence.mechanism.primary_joints):
        v, torque = rows.velocity[:, j], rows.torque[:, j]
        rubbing = values[f"{joint.name}.viscous"] * v + values[f"{joint.name}.coulomb"] * np.sign(v)
        drives = np.mean(rubbing * v) < DRIVING * np.sqrt(np.mean(v**2) * np.mean(torque**2))
        if drives and _is_needed(evidence, equations, f"{joint.name}.", deviations):
            raise InputError(
                f"{source}: joint {joint.name!r}: its torques go against its motion, as if friction drove it: is the "
                "sign of its gear ratio, or of its torque or position column, right?"
            )
    if left > UNEXPLAINED:
        raise InputError(
            f"{source}: the equations of {evidence.mechanism.name} leave {left:.0%} of the torques unexplained: is it "
            "this robot's log, are columns, transmission and units right, or are encoders so noisy (then instruments)?"
        )


def _is_needed(evidence: LogEvidence, equations: NormalEquations, joint: str, deviations: Array) -> bool:
    """True if the rows are fitted much worse without a joint's friction; else its values may be anything."""
    names, columns = evidence.mechanism.parameter_names, evidence.independent(FrictionModel())
    energetic = evidence.mechanism.energetic
    others = np.array([c for c in columns.tolist() if c < energetic or not names[c].startswith(joint)])
    whitened, weight = equations.whitened(deviations), 1.0 / deviations**2
    best, without = (equations.misfit(least_squares(*whitened, kept)) @ weight for kept in (columns, others))
    return bool(without > NEEDED * best)
