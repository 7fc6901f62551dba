"""The rank by the paper's own rule: singular values above a share of the largest (section 3.1)."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.verdict import Claim, Outturn, percent

THRESHOLD = float(np.sqrt(np.finfo(np.float64).eps))
"""The square root of the machine precision."""


def paper_rank(singular_values: Array) -> Array:
    """Rank of each of several matrices (...) by the rule of Sheu and Walker (1991, section 3.1): the number of its
    singular values that are greater than the first one times the square root of the machine precision.
    `singular_values` (..., P) has P for each matrix, in descending order. Raises `IndexError` for a single number."""
    return np.count_nonzero(singular_values > THRESHOLD * singular_values[..., :1], axis=-1)


def rank_claim(claim: str, singular_values: Array, certified: int) -> Claim:
    """Judgement, a `Claim`, of a statement of Sheu and Walker (1991) on a rank: on which fraction of the random draws
    the paper's own threshold finds the rank that it prints. `claim` is the name of the statement's quotation, such as
    "puma_rank"; `singular_values` (seeds, P), in descending order, are those of each draw's energy differences,
    `certified` is the rank certified here. Raises `KeyError` for an unknown quotation."""
    saying = printed().claims[claim]
    share = float(np.mean(paper_rank(singular_values) == int(saying.numbers)))
    return Claim(
        saying,
        "singular values above the square root of the machine precision, as a share of the largest",
        f"rank {saying.numbers} on {percent(share)} of the seeds; certified rank {certified}",
        Outturn.REPRODUCED if share == 1.0 else Outturn.NOT_REPRODUCED,
        share,
    )
