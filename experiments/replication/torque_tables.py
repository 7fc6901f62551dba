"""Torque errors of Tables 3 and 10, when only some components are kept."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import StatedMotion
from adaptctl.experiments.replication.draws import Draws
from adaptctl.experiments.replication.printed import Table, printed
from adaptctl.experiments.replication.verdict import Check, Claim, Outturn, Relations, drawn, percent, vanishing

ENERGY = "energy error [%]"
ROUND_OFF = 1e-15
"""(N m)^2 or percent: what is left when every component is kept stays below"""
COUNTS = (10, 20, 23, 25, 26, 30, 34, 35, 36)
"""The numbers of components of Tables 3 and 10 together."""
CLOSE = (0.05, 0.01, 0.001)
"""Root mean square torque errors, over the torque's own, that may be called very close; the first one judges."""


def checked_torque_errors(table: Table, percent: Array, errors: Array) -> tuple[Check, ...]:
    """Checks, a `Check` each, of every printed entry of Table 3 or 10 of Sheu and Walker (1991), `table`, in its order,
    against the computed errors of models with the first j = 0, 1, ..., k of the k essential components. (These are the
    parameters' parts along the right singular vectors of energy differences.) The errors are energy errors `percent`
    (seeds, k + 1), %, and mean square torque errors `errors` (seeds, k + 1, r), (N m)^2, of r joints, for each of
    several random draws (seeds). The verdict is IN_SHAPE for an entry from the draws' least to their greatest value.
    With all k components only round-off is left: there it is IN_SHAPE for an entry that is below 1e-15 where the draws'
    median is too. Else it is NOT_REPRODUCED. Nothing is checked."""
    last = percent.shape[1] - 1
    checks = []
    for row, column, text in table.entries():
        s = int(column)
        values = percent[:, s] if row == ENERGY else errors[:, s, int(row.removeprefix("joint")) - 1]
        whole = vanishing(row, column, text, float(np.median(values)), ROUND_OFF)
        checks.append(whole if s == last else drawn(row, column, text, values))
    return tuple(checks)


def medians(percent: Array, errors: Array) -> Relations:
    """Table, as `Relations` (a heading and lines of text), of the medians of errors over random draws (seeds), a line
    for each number of essential components that Table 3 or 10 of Sheu and Walker (1991) has. (These are the parameters'
    parts along the right singular vectors of energy differences.) The errors are energy errors `percent` (seeds, k +
    1), %, and mean square torque errors `errors` (seeds, k + 1, r), (N m)^2, of r joints. Nothing is checked."""
    lines = [f"{'components':>10}  {'energy [%]':>10}" + "".join(f"  joint{j + 1:<2}" for j in range(errors.shape[-1]))]
    for s in (count for count in COUNTS if count < percent.shape[1]):
        torque = "".join(f"  {value:.1E}" for value in np.median(errors[:, s], axis=0))
        lines.append(f"{s:>10}  {np.median(percent[:, s]):>10.2g}{torque}")
    return Relations("Medians over the seeds: energy errors, and mean square torque errors in (N·m)²", tuple(lines))


def fewest_components(claim: str, printed_count: int, draws: Draws, errors: Array, motion: StatedMotion) -> Claim:
    """Judgement, a `Claim`, of a statement of Sheu and Walker (1991) on the number of essential components (the
    parameters' parts along the right singular vectors of energy differences) that an accurate torque needs. It holds
    where at least half of the random draws need `printed_count` or more for an RMS torque error of at most 5 % of the
    RMS torque at every joint. `claim` is the name of the statement's quotation, such as "puma_torque"; `errors` (seeds,
    k + 1, r), (N m)^2, are the mean square torque errors of `draws` along `motion` with 0 to k components at r joints.
    Raises `KeyError` for an unknown quotation."""
    needed = {share: _needed(draws, errors, motion, share) for share in CLOSE}
    judged = float(np.mean(needed[CLOSE[0]] >= printed_count))
    middle = ", ".join(f"{np.median(count):.0f} within {percent(share)}" for share, count in needed.items())
    return Claim(
        printed().claims[claim],
        f"the fewest components with which every joint's root mean square torque error is within {percent(CLOSE[0])} "
        "of its torque's along the stated sinusoid; the paper does not say what is accurate",
        f"{printed_count} or more on {percent(judged)} of the seeds; medians {middle}",
        Outturn.IN_SHAPE if judged >= 0.5 else Outturn.NOT_REPRODUCED,
        judged,
    )


def _needed(draws: Draws, errors: Array, motion: StatedMotion, share: float) -> Array:
    """Components (seeds,) from which on every joint's error stays within a share of its torque."""
    torque = motion.Y @ draws.arm.parameters
    fine = (errors <= share**2 * np.mean(torque**2, axis=0)).all(axis=-1)
    return fine.shape[1] - np.logical_and.accumulate(fine[:, ::-1], axis=1).sum(axis=1)
