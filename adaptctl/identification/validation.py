"""Measured against predicted torques, on rows that no fit has seen."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, whole_number
from adaptctl.caching import cached_property
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import InputError
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.friction_model import ALWAYS, FrictionModel
from adaptctl.identification.least_squares import least_squares, weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a model on n rows of a log: `measured` and `predicted` torques (n, r) of r joints, N m (N for a
    prismatic joint), at instants when the arm moves. Both went through one low-pass filter of `cutoff` Hz.

    `origin` says in words which rows these are, and `time` (n,) is in s, as in the log; predictions are from the
    measured motion alone. Raises `InputError` for arrays of other shapes, and for no rows or no joints.
    """

    origin: str
    cutoff: float
    time: Array
    measured: Array
    predicted: Array

    def __post_init__(self) -> None:
        time, measured, predicted = map(np.shape, (self.time, self.measured, self.predicted))
        if len(measured) != 2 or 0 in measured or predicted != measured or time != measured[:1]:
            raise InputError(
                "validation: expected times (n,) and measured and predicted torques of one shape (n, r), n and r at "
                f"least 1, got {time}, {measured} and {predicted}"
            )

    @property
    def rms_error(self) -> float:
        """Root mean square torque error (predicted less measured) over all joints and instants, N m (N for prismatic
        joints)."""
        return float(np.sqrt(np.mean(np.square(self.error))))

    @property
    def relative_error(self) -> float:
        """Relative torque error, without a unit: sqrt(sum of errors^2 / sum of measured torques^2), both sums over all
        joints and instants. 0 where all errors are zero; else infinite where all measured torques are zero."""
        return float(_relative(np.linalg.norm(self.error), np.linalg.norm(self.measured)))

    @property
    def joint_rms_errors(self) -> Array:
        """Root mean square torque errors (r,) of each of r joints over all instants, N m (N for a prismatic joint)."""
        return np.sqrt(np.mean(np.square(self.error), axis=0))

    @property
    def joint_relative_errors(self) -> Array:
        """Relative torque errors (r,) of r joints, without a unit: for each joint sqrt(sum of errors^2 / sum of
        measured torques^2), both sums over all instants. 0 where all its errors are zero; else infinite where all its
        measured torques are zero."""
        return _relative(np.linalg.norm(self.error, axis=0), np.linalg.norm(self.measured, axis=0))

    @cached_property
    def error(self) -> Array:
        """Torque errors (n, r) at n instants, of r joints, predicted minus measured, N m (N for a prismatic joint)."""
        return self.predicted - self.measured

    def autocorrelation(self, lags: int = 50) -> Array:
        """Autocorrelation (lags + 1, r) of the torque errors of r joints less their means, without a unit, at 0 to
        `lags` rows apart (a whole number of at least 0; any above n - 1, for n rows, counts as n - 1). It is 1 at lag
        0, and about 0 at others for white errors; for a joint whose errors are all equal it is 0 at others. Raises
        `InputError` for other lags."""
        count = min(whole_number(lags, "lags", 0, sys.maxsize), len(self.error) - 1)
        centred = np.where(np.ptp(self.error, axis=0) > 0.0, self.error - self.error.mean(axis=0), 0.0)
        whole = np.square(centred).sum(axis=0)
        whole[whole == 0.0] = 1.0
        later = [(centred[: len(centred) - k] * centred[k:]).sum(axis=0) / whole for k in range(1, count + 1)]
        return np.stack([np.ones(len(whole)), *later])


def _relative(error: ArrayLike, size: ArrayLike) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.equal(error, 0.0), 0.0, np.divide(error, size))


def predicted_torques(rows: Rows, x: Array, load: Array | None) -> Array:
    """Torques (n, r) of r joints, N m (N for a prismatic joint), that parameters `x` predict at the n instants of
    low-pass filtered equations of motion, `rows`. `x` (P + r,), SI units, are the P parameters of the rows' regressor
    and the r coefficients (unitless) of load-dependent friction, its torque over that of the joint without friction.
    `load` (n, r, r), N m (N), are the columns of these; None leaves that friction out. Raises `ValueError` for arrays
    of unlike shapes."""
    P = rows.regressor.shape[-1]
    rigid = rows.regressor @ x[:P]
    return rigid if load is None else rigid + load @ x[P:]


class Alternative(NamedTuple):
    """Alternative estimate of a robot's parameters, from a simpler model: its `name`, a description as text, and its
    parameters `x` (P + r,), SI units. The first P are those of the mechanism with all kinds of friction, in the order
    of its `parameter_names`; then comes, for each of r primary (independent) joints, the coefficient (unitless) of
    load-dependent friction, its torque over that of the joint without friction. Made by `alternatives`; nothing is
    checked at construction."""

    name: str
    x: Array


PLAIN = FrictionModel((*ALWAYS, DriveParameter.OFFSET))


def alternatives(evidence: LogEvidence, fit: Fit, mechanism_fit: Fit) -> list[Alternative]:
    """Alternative estimates, a list of `Alternative`, by simpler models on all blocks of time of the evidence (low-pass
    filtered equations of motion along logs) that a `fit` was made from.

    They are: `mechanism_fit`, the fit without load-dependent friction (that grows with the joint's torque), unless it
    is `fit` itself; weighted least squares with the same friction; weighted least squares with viscous and Coulomb
    friction and an offset alone; the prior's links (the robot file's) with friction and rotors fitted by least squares;
    and friction and rotors alone, links being zero. Raises `KeyError` for a fit at a cut-off that the evidence does not
    have.
    """
    friction, cutoff = mechanism_fit.settings.friction, fit.settings.cutoff
    every = range(evidence.blocks)
    found = [] if fit is mechanism_fit else [Alternative("without load-dependent friction", mechanism_fit.x)]
    return [
        *found,
        Alternative("weighted least squares, the same friction", evidence.ordinary(friction, cutoff, every)),
        Alternative(f"weighted least squares, {PLAIN.words}", evidence.ordinary(PLAIN, cutoff, every)),
        Alternative("the robot file's links, friction and rotors fitted", _drives_alone(evidence, fit, every, True)),
        Alternative("friction and rotors alone", _drives_alone(evidence, fit, every, False)),
    ]


def _drives_alone(evidence: LogEvidence, fit: Fit, blocks: Sequence[int], links: bool) -> Array:
    """Links as the prior has them, or none; the drives' parameters by weighted least squares."""
    equations = evidence.equations(fit.settings.cutoff, blocks)
    A, b = equations.whitened(fit.deviations)
    tens = evidence.prior.tens.ravel()
    known = np.zeros(len(b))
    known[: tens.size] = tens if links else 0.0
    mask = evidence.mask(FrictionModel(fit.settings.friction.kinds))
    drives = np.array([c for c in np.flatnonzero(mask).tolist() if c >= tens.size])
    return known + least_squares(A, b - A @ known, drives)


DRIVING = -0.3
"""Power of friction over the product of root mean square torque and speed, below which a sign must be wrong."""
NEEDED = 1.5
"""Squares without a joint's friction over those with it, from where on friction is seen."""
UNEXPLAINED = 0.5
"""Share of the torques that least squares may leave of its own rows."""


def validate_plausible(evidence: LogEvidence, source: str, cutoff: float) -> None:
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
    energetic = evidence.mechanism.num_energy_parameters
    others = np.array([c for c in columns.tolist() if c < energetic or not names[c].startswith(joint)])
    whitened, weight = equations.whitened(deviations), 1.0 / deviations**2
    best, without = (equations.misfit(least_squares(*whitened, kept)) @ weight for kept in (columns, others))
    return bool(without > NEEDED * best)
