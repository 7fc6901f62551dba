"""Instruments against noise of positions in the regressors: odd samples for even ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.errors import InputError
from adaptctl.identification.choice import NUM_BLOCKS
from adaptctl.identification.filtered_dynamics import motions_of, rows_of
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import rows_without_payloads
from adaptctl.identification.least_squares import halves, joined_first_stage, weighted_least_squares
from adaptctl.identification.momentum_balance import MomentumBalance
from adaptctl.identification.normal_equations import block_edges
from adaptctl.identification.position_noise import MAX_NOISE_SHARE, noise_share
from adaptctl.identification.uncertainty import scaled_inverse
from adaptctl.stages import stage

# F statistic below which an instrument is weak (Staiger and Stock 1997), and share of a log's rate up to which its
# halves can be filtered.
WEAK_INSTRUMENT, MAX_CUTOFF_SHARE = 10.0, 0.05


@stage("measuring the noise of positions")
def without_position_noise(
    measured: LogEvidence, cutoff: float, wanted: bool | None
) -> tuple[LogEvidence, tuple[str, ...]]:
    """Evidence with instruments if they are wanted, or by default if noise below a cut-off asks for them; a remark."""
    share = noise_share(measured.motions, cutoff)
    worst = int(share.argmax())
    if wanted is False or (wanted is None and (share[worst] <= MAX_NOISE_SHARE or not _cutoffs(measured))):
        return measured, ()
    freed = freed_of_noise(measured)
    lower = "" if cutoff == measured.band else f"; a cut-off of {measured.band:.3g} Hz leaves most of it out"
    said = (
        f"{share[worst]:.2g} of the squares of {measured.mechanism.primary_joints[worst].name}'s accelerations below "
        f"{cutoff:.3g} Hz are noise of its positions{lower}; odd samples are the instruments of even ones, the weakest "
        f"that of {_weakest(measured, freed)}"
    )
    return freed, (said,)


def freed_of_noise(evidence: LogEvidence) -> LogEvidence:
    """Evidence whose regressors are freed of encoder noise by instrumental variables (even against odd samples)."""
    evidence = evidence.sampled
    pairs, cutoffs = [halves(motion.log) for motion in evidence.motions], _cutoffs(evidence)
    if not cutoffs:
        raise InputError(
            "instrumental_variables: the sampling rate is too low to split the log into even and odd samples"
        )
    smooth = evidence.motions[0].cutoff
    motions, others = (list(motions_of(side, smooth)) for side in zip(*pairs, strict=True))
    balance = MomentumBalance(evidence.mechanism)
    own = rows_without_payloads(motions, balance, evidence.drives, cutoffs)
    instruments = rows_of(others, balance, cutoffs)
    rows = dict(zip(cutoffs, joined_first_stage(own, instruments), strict=True))
    moved = rows[min(cutoffs)].moved
    return replace(evidence, motions=motions, rows=rows, edges=block_edges(moved.log, moved.time, NUM_BLOCKS))


def _cutoffs(evidence: LogEvidence) -> list[float]:
    """Cut-offs (Hz) that samples of half the rate can be filtered at."""
    rate = min(motion.log.rate for motion in evidence.motions)
    return [cutoff for cutoff in evidence.rows if cutoff <= MAX_CUTOFF_SHARE * rate]


def _weakest(measured: LogEvidence, freed: LogEvidence) -> str:
    """Parameter that instruments tell least about, and the partial F of its first stage (Shea 1997), in words."""
    settings = FitSettings(FrictionModel(), 1.0, max(freed.rows))
    columns, every = measured.independent(settings), range(measured.blocks)
    equations = measured.equations(settings, every)
    _, deviations = weighted_least_squares(equations, columns)
    projected = freed.equations(settings, range(freed.blocks))
    own, other = (
        np.diag(scaled_inverse(one.whitened(deviations)[0], columns))[columns] for one in (equations, projected)
    )
    explained = np.clip(own / other * projected.count.sum() / equations.count.sum(), 0.0, 1.0 - 1e-12)
    F = explained / (1.0 - explained) * max(float(projected.count.sum()) / len(columns) - 1.0, 0.0)
    k = int(F.argmin())
    name = measured.mechanism.parameter_names[columns[k]]
    return f"{name} (F = {F[k]:.3g}, {'which is weak' if F[k] < WEAK_INSTRUMENT else 'not weak'})"
