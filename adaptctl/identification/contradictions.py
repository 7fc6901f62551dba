"""Contradictions between a log, the robot's file and physics, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.plausibility import implausible_masses
from adaptctl.identification.choice import MAX_MISFIT_RATIO, OTHER_ROBOT_RATIO, WEIGHT_CANDIDATES, misfit_ratio
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.held_out import HeldOut
from adaptctl.identification.least_squares import least_squares
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.validation import Validation

# Error of rows held out over that of rows fitted, and share of a joint's torque, from where on something has changed;
# and share of all torques, in the band of the motion, from where on the log is not what it seems.
CHANGED_RATIO, CHANGED, POOR = 2.5, 0.1, 0.2
CHECK = "check for a counterbalance, for gravity compensation, and for its torque's sign and unit"
"""what a joint that weighs otherwise may mean"""

OTHER_ROBOT = " (check that the log is this robot's, and the order, signs and units of its columns)"


def contradictions(evidence: LogEvidence, fit: Fit, other_side: bool = False) -> Iterator[str]:
    """
    Sentences on joints at which the file's links weigh something else, and on joints left out.

    Placeholders weigh nothing of the robot's; torques of gears' other side are told already.
    """
    cutoff, told = fit.settings.cutoff, other_side or evidence.prior.is_placeholder
    means, otherwise = evidence.file_torques(cutoff), evidence.weighing_otherwise(cutoff)
    for j, joint in enumerate(evidence.mechanism.primary_joints):
        file, measured = (f"{abs(mean):.3g} {joint.kind.effort_unit}" for mean in means[:, j])
        weighs = f"{joint.name}: the links of the robot file take {file} on average, the log has {measured}"
        if j in fit.settings.left_out:
            yield (
                f"{weighs}; no links that bodies can be take both this and the torques of the other joints, so it is "
                f"left out of fit and verdict; {CHECK}"
            )
        elif j in otherwise and not told:
            yield f"{weighs}; {CHECK}{_offset(evidence, fit, j)}"


def implausible_links(found: Mechanism, file: Mechanism) -> Iterator[str]:
    """Warning of identified links that no part is like, but for those that the robot's file has so already."""
    if links := implausible_masses(found.description, file.description):
        yield (
            f"implausible: {'; '.join(links)}: the log does not tell these numbers one by one, only torques of such "
            "motions; a faster motion of more joints would, and a larger --prior-weight keeps them nearer to the file"
        )


def poorly_predicted(evidence: LogEvidence, fit: Fit, judged: Validation) -> Iterator[str]:
    """Warning of rows held out that are predicted far worse than those fitted, or badly as these are."""
    errors, joints = judged.joint_relative_errors, evidence.mechanism.primary_joints
    equations = evidence.equations(fit.settings.judging(judged.cutoff), range(evidence.blocks))
    fitted = np.sqrt(equations.misfit(fit.x) / np.maximum(equations.square.sum(axis=0), np.finfo(float).tiny))
    kept = np.isin(np.arange(len(joints)), judged.left_out, invert=True)
    worse = np.flatnonzero(kept & (errors > CHANGED_RATIO * fitted) & (errors > CHANGED))
    if worse.size:
        each = ", ".join(
            f"{errors[j]:.0%} of {joints[j].name}'s ({fitted[j]:.0%} where fitted)" for j in worse.tolist()
        )
        yield (
            f"the estimate leaves {each} torques on the rows held out: something changed, such as a payload, an "
            "encoder's zero or friction, or these rows move as no fitted ones do; look at both parts, and cut the log"
        )
    elif judged.relative_error > POOR:
        j = int(np.argmax(np.where(kept, judged.joint_rms_errors, 0.0)))
        motor = evidence.drives.motors[j]
        yield (
            f"the estimate leaves {judged.relative_error:.0%} of the torques in the band of the motion, most at "
            f"{joints[j].name}: check its columns {motor.position!r} and {motor.torque!r}, and filters and stamps"
        )


class Excess(NamedTuple):
    """Line on a misfit above that of least squares, and a warning if these also predict rows held out better."""

    step: PreparationStep
    warning: str | None = None


def excess_misfit(evidence: LogEvidence, fit: Fit, held_out: HeldOut) -> Excess:
    """
    Misfit above that of least squares, by the weight of the prior or by what bodies can be.

    Least squares follow noise, too: that they fit the training rows better says nothing unless they predict better.
    """
    ratio = misfit_ratio(evidence, fit)
    name = "error over that of least squares"
    if ratio <= MAX_MISFIT_RATIO:
        return Excess(PreparationStep(name, f"{ratio - 1.0:.1%} on the training rows"))
    every = range(evidence.blocks)
    free = evidence.ordinary(fit.settings, every)
    own, least = (held_out.of(x).relative_error for x in (fit.x, free))
    above = f"the error on the training rows is {ratio - 1.0:.1%} above that of least squares"
    light = evidence.fit(replace(fit.settings, weight=WEIGHT_CANDIDATES[0]), every)
    bodies = misfit_ratio(evidence, light)
    names = ", ".join(forced(evidence, light if bodies > MAX_MISFIT_RATIO else fit))
    if bodies > MAX_MISFIT_RATIO:
        other = bodies > OTHER_ROBOT_RATIO
        why = (
            f"{bodies - 1.0:.1%} forced by {names}, whatever the prior: what least squares ask of it no body can have"
            f"{OTHER_ROBOT if other else ''}"
        )
    else:
        why = (
            f"by the weight {fit.settings.weight:g} of the prior and most at {names}; with less weight the estimate "
            "follows these rows more closely"
        )
    told = f"{above}, {why}; of the rows held out the estimate leaves {own:.2%}, and least squares {least:.2%}"
    return Excess(PreparationStep(name, told), told if own > MAX_MISFIT_RATIO * least else None)


def _offset(evidence: LogEvidence, fit: Fit, j: int) -> str:
    joint = evidence.mechanism.primary_joints[j]
    name = f"{joint.name}.{DriveParameter.OFFSET.value}"
    value = float(fit.x[evidence.mechanism.parameter_names.index(name)])
    return f"; a constant {value:.3g} {joint.kind.effort_unit} is in its offset" if value else ""


def forced(evidence: LogEvidence, fit: Fit) -> list[str]:
    """Names of the links or drives that have most of the misfit above least squares, the largest part first."""
    # With g the slope of the squares at the fit, d its way to least squares, the misfit above theirs is -g'd/2: a sum
    # over links and drives.
    every, names = range(evidence.blocks), evidence.mechanism.parameter_names
    A, b = evidence.equations(fit.settings, every).whitened(fit.deviations)
    kept = np.flatnonzero(fit.settings.columns(evidence.mechanism))
    slope = A @ fit.x - b
    parts = -0.5 * slope * least_squares(A, -slope, kept)
    owners = [name.rsplit(".", 1)[0] for name in names]
    shares = dict.fromkeys(owners, 0.0)
    for k in kept.tolist():
        shares[owners[k]] += float(parts[k])
    ordered = sorted(shares, key=lambda owner: -shares[owner])
    return [owner for owner in ordered if shares[owner] > 0.5 * shares[ordered[0]]][:3]
