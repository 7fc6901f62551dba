"""The rank by the paper's own rule: singular values above a share of the largest (section 3.1)."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.verdict import Claim, Outturn, percent

THRESHOLD = float(np.sqrt(np.finfo(np.float64).eps))
"""The square root of the machine precision."""


def paper_rank(singular_values: Array) -> Array:
    """Rank by the rule of Sheu and Walker (1991, section 3.1): the number (...) of singular values (..., P), P for each
    matrix in falling order, that are greater than the first one times the square root of the machine precision. Raises
    `IndexError` for a single number."""
    return np.count_nonzero(singular_values > THRESHOLD * singular_values[..., :1], axis=-1)


def rank_claim(claim: str, singular_values: Array, certified: int) -> Claim:
    """Claim of Sheu and Walker (1991) on a rank, judged: the share of the random draws on which the paper's own
    threshold finds the rank it prints. `claim` is the name of the quotation, such as "puma_rank"; `singular_values`
    (seeds, P), falling, are those of each draw's energy differences, `certified` is the rank certified here. Raises
    `KeyError` for an unknown quotation."""
    saying = printed().claims[claim]
    share = float(np.mean(paper_rank(singular_values) == int(saying.numbers)))
    return Claim(
        saying,
        "singular values above the square root of the machine precision, as a share of the largest",
        f"rank {saying.numbers} on {percent(share)} of the seeds; certified rank {certified}",
        Outturn.REPRODUCED if share == 1.0 else Outturn.NOT_REPRODUCED,
        share,
    )
