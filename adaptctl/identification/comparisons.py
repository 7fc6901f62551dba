"""Simpler models of the same robot on the same rows, to compare an estimate with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.friction_model import ALWAYS, FrictionModel
from adaptctl.identification.least_squares import least_squares


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
