"""The rank by the paper's own rule: singular values above a share of the largest (section 3.1)."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.verdict import Claim, Outturn, percent

THRESHOLD = float(np.sqrt(np.finfo(np.float64).eps))
"""The square root of the machine precision."""


def paper_rank(singular_values: Array) -> Array:
    """Number of the falling singular values (..., P) that count."""
    return np.count_nonzero(singular_values > THRESHOLD * singular_values[..., :1], axis=-1)


def rank_claim(claim: str, singular_values: Array, certified: int) -> Claim:
    """Claim on how often, over singular values (seeds, P), the paper's threshold finds the paper's rank."""
    saying = printed().claims[claim]
    share = float(np.mean(paper_rank(singular_values) == int(saying.numbers)))
    return Claim(
        saying,
        "singular values above the square root of the machine precision, as a share of the largest",
        f"rank {saying.numbers} on {percent(share)} of the seeds; certified rank {certified}",
        Outturn.REPRODUCED if share == 1.0 else Outturn.NOT_REPRODUCED,
        share,
    )
