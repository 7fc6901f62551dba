"""Evidence gathered from logs: filtered equations of motion, in blocks of time."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.identification.choice import (
    COMPARISON_CUTOFF,
    MIN_CUTOFF,
    NUM_BLOCKS,
    cutoffs_for,
)
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.entropic import EntropicPrior, prior_links
from adaptctl.identification.filtered_dynamics import (
    MOTION_CUTOFF,
    Rows,
    SmoothMotion,
    motion_band,
    motions_of,
    rows_of,
)
from adaptctl.identification.fit import LogEvidence, positive_columns
from adaptctl.identification.friction_model import with_all_friction
from adaptctl.identification.long_logs import LongEvidence, Stretches
from adaptctl.identification.momentum_balance import MomentumBalance
from adaptctl.identification.normal_equations import block_edges
from adaptctl.identification.payloads import without_payloads
from adaptctl.identification.preparation import PreparationStep, PreparedLog, prepare
from adaptctl.stages import stage

# Cut-offs of rows and of positions over the frequency below which the motion is, and the least of the latter in Hz.
BAND_CUTOFF_RATIO, MOTION_CUTOFF_RATIO, MIN_MOTION_CUTOFF = 5.0, 16.0, 20.0
# s of motion below which nothing is learnt, and below which intervals and the choice of friction are rough.
MIN_DURATION, SHORT_DURATION = 1.5, 5.0
SHORT = (
    "{}: a short log, of {:.2g} s of motion: delay, form of friction and intervals are rough, and wrong columns may "
    "go unseen; record 15 s or more"
)


@stage("filtering motions and torques")
def gathered(
    mechanism: Mechanism,
    drives: Drives,
    logs: Sequence[JointLog],
    skip: Collection[str] = (),
    cutoff: float | None = None,
    cutoffs: Sequence[float] = (),
    band: float | None = None,
) -> tuple[LogEvidence, tuple[PreparationStep, ...], tuple[str, ...]]:
    """Evidence of logs, the steps of their preparation, and remarks on links that were not consistent."""
    prepared = [prepare(log, mechanism, skip) for log in logs]
    pieces = [piece for found, _ in prepared for piece in found]
    steps = tuple(dict.fromkeys(step for _, own in prepared for step in own))
    full, (tens, remarks) = with_all_friction(mechanism, drives), prior_links(mechanism)
    remarks = [*_turns(steps), *remarks]
    fastest = motion_band(pieces) if band is None else band / BAND_CUTOFF_RATIO
    least = min(max(MIN_CUTOFF, BAND_CUTOFF_RATIO * fastest), COMPARISON_CUTOFF)
    smooth = min(max(MIN_MOTION_CUTOFF, MOTION_CUTOFF_RATIO * fastest), MOTION_CUTOFF)
    rate = min(piece.rate for piece in pieces)
    tried = sorted({*(cutoffs or cutoffs_for(rate, least)), *([cutoff] if cutoff else [])})
    stretches = Stretches(pieces, full, drives, smooth, tried)
    if cutoff is not None:
        stretches.validate(cutoff)
    long = stretches.are_long
    motions = stretches.windows() if long else list(motions_of(pieces, smooth))
    balance = stretches.balance if long else MomentumBalance(full)
    rows = dict(zip(tried, rows_without_payloads(motions, balance, drives, tried), strict=True))
    lasts = _validate_enough(pieces)
    remarks += [SHORT.format(pieces[0].source, lasts)] if lasts < SHORT_DURATION else []
    positive, scales = positive_columns(full, tens)
    basis, prior = fundamental_basis(essential_space(full)), EntropicPrior(tens, positive, scales)
    told = steps, tuple(remarks)
    if long:
        own = [(motion.number, float(motion.log.time[0])) for motion in motions]
        each = (full, basis, drives, prior, motions, rows, own, min(rows))
        return LongEvidence(*each, stretches, tuple(range(len(own)))), *told
    moved = rows[min(rows)].moved
    edges = block_edges(moved.log, moved.time, NUM_BLOCKS)
    return LogEvidence(full, basis, drives, prior, motions, rows, edges, min(rows)), *told


def rows_without_payloads(
    motions: Sequence[SmoothMotion], balance: MomentumBalance, drives: Drives, cutoffs: Sequence[float]
) -> list[Rows]:
    """Rows of each cut-off (Hz), the torques of known payloads taken off."""
    return [without_payloads(own, motions, balance.mechanism, drives) for own in rows_of(motions, balance, cutoffs)]


def _turns(steps: Sequence[PreparationStep]) -> list[str]:
    """Words on full turns that were removed, if any were, and the step was not skipped."""
    return [step.outcome for step in steps if step.name == "unwrap" and step.outcome[0] in "123456789"]


def _validate_enough(pieces: Sequence[PreparedLog]) -> float:
    """Motion in s. Raises `InputError` where that is too little."""
    lasts = float(sum(np.sum(piece.moving) / piece.rate for piece in pieces))
    if lasts < MIN_DURATION:
        raise InputError(
            f"{pieces[0].source}: the log has only {lasts:.2g} s of motion; at least {MIN_DURATION:g} s are needed, "
            "and ten times as much for good estimates"
        )
    return lasts
