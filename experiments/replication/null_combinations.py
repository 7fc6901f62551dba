"""Combinations of inertial parameters by name, in the paper's words: ``I_y1 - I_x3 - I_z3``."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import SampledArm
from adaptctl.experiments.replication.paper_layout import index, sign

NULL_COMBINATIONS = (
    "I_y1 - I_x3 - I_z3",
    "I_x3 + I_y3 - I_x4 - I_z4",
    "I_x4 + I_y4 + I_y5 - I_z5 - I_x6 - I_y6",
)
"""Made of parameters that Table 5 keeps; with exact right angles they change no torque."""
STATES = 500


def combination(text: str, links: int = 6) -> Array:
    """Coefficients (10 N,), no unit, of a linear combination of inertial parameters that a `text` states in Sheu and
    Walker's (1991) names, such as "I_y1 - I_x3 - I_z3", whose last digits are the links from 1 on. They are of m, mc_x,
    mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz of each of N = `links` links. Raises `ValueError` for a name that the
    paper does not have and a link below 1, `IndexError` for a link beyond N."""
    out = np.zeros(10 * links)
    for factor, term in _terms(text):
        out[index(term[:-1], term[-1])] = factor * sign(term[:-1])
    return out


def torque_share(arm: SampledArm, text: str) -> float:
    """Ratio max |Y c| / max |Y_j| (no unit), the maxima over 500 random states, the same in every call, and all joints:
    the largest torque that a combination c of inertial parameters makes, over the largest that any one of its terms j
    makes alone; Y is the torque regressor of an `arm` of six links. It is of the size of round-off where the
    combination changes no torque. `text` is the combination in Sheu and Walker's (1991) names, such as "I_y1 - I_x3 -
    I_z3"; raises `ValueError` for a name that the paper does not have, `IndexError` for a link beyond the sixth."""
    vector = combination(text)
    p, v, a = np.random.default_rng(0).normal(size=(3, STATES, arm.mechanism.dof))
    Y = arm.mechanism.torque_regressor(p, v, a)
    return float(np.abs(Y @ vector).max() / np.abs(Y[..., vector != 0.0]).max())


def _terms(text: str) -> list[tuple[float, str]]:
    words = ("+ " + text).split()
    return [(1.0 if mark == "+" else -1.0, term) for mark, term in zip(words[::2], words[1::2], strict=True)]
