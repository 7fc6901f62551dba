"""A short search about the proposed gains, judged by disturbed runs."""

from __future__ import annotations

from typing import cast

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.tuning.prior_gain import Shares
from adaptctl.tuning.proposal import Proposal, Proposals
from adaptctl.tuning.rough_links import scaled_links
from adaptctl.tuning.trial import Trials, TrialSetting
from adaptctl.tuning.verification import ASTRAY, CLIPPED, LINKS_OFF, measures

DURATION = 8.0
"""s of a run"""
BANDWIDTHS, HOLDS, NUMBERS = (4.0, 8.0), (0.25, 0.5), (0.1, 0.2, 0.4, 0.8)
SHARES: tuple[Shares, ...] = ("mixed", "links", "parameters")


def searched(trials: Trials, proposals: Proposals, first: Proposal, count: int, seed: int) -> Proposal:
    """The best of the `first` proposal of gains and `count` others, a `Proposal`: the one whose tracking error (RMS
    over all joints and the last 2 s, of the worse of two simulated runs of 8 s) is least. The others are drawn by
    `seed` from a grid of 48, none twice, less those for which there are no gains.

    In both runs the ten inertial parameters of each link are 30 % up or down, in another way each; in the second run
    torques come a control period late besides, for gains judged without a delay may be unstable with one. Runs in which
    a joint's error reached 1 rad (m if prismatic), or in which a torque was at its limit for over 5 % of the second
    half, count as failed; where all fail, the first proposal is returned. `trials` runs them, `proposals` makes the
    gains. Raises `InputError` where the mechanism has more than 100 links, for which no native code is made.
    """
    tried = [first, *_drawn(proposals, count, seed)]
    arms = [scaled_links(trials.plant.mechanism, LINKS_OFF, seed + k) for k in (1, 2)]
    settings = [
        TrialSetting(one.carried.gains.bandwidth, one.carried.gains.damping, one.gain, true, late)
        for one in tried
        for true, late in zip(arms, (False, True), strict=True)
    ]
    runs = trials.run(settings, DURATION)
    _, last, largest, limited = measures(runs, np.asarray(trials.plant.torque_limits))
    failed = (largest >= ASTRAY) | (limited > CLIPPED)
    worse: Array = np.where(failed, np.inf, last).reshape(-1, 2).max(axis=1)
    return tried[int(worse.argmin())]


def _drawn(proposals: Proposals, count: int, seed: int) -> list[Proposal]:
    """Proposals of different numbers, in an order by seed; as many as there are."""
    grid = [(a, b, c, kind) for a in BANDWIDTHS for b in HOLDS for c in NUMBERS for kind in SHARES]
    order = np.random.default_rng(seed).permutation(len(grid))[:count]
    found = []
    for bandwidth, hold, number, kind in (grid[k] for k in order):
        try:
            found.append(proposals.proposed(bandwidth, hold, number, cast(Shares, kind)))
        except InputError:  # no gains hold the arm: the first proposal has said so
            continue
    return found
