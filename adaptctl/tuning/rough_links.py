"""Links that are not what their description says."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism


def scaled_links(mechanism: Mechanism, share: float, seed: int) -> Array:
    """All P inertial and friction parameters (P,) of a `mechanism` with rescaled links, SI units, in the order of its
    `parameter_names`. The ten inertial ones of each body (link) are multiplied by 1 + `share` or 1 - `share`, no unit,
    with equal probability, drawn by `seed`, a whole number of at least 0, the same for equal seeds. With a share below
    1 a rigid body stays one; drives keep their parameters. Under linear constraints on the parameters only those that
    are free, which `parameter_names` then has, are multiplied and returned; the others follow from them, so that a body
    need not stay one. Nothing is checked."""
    names, bodies = mechanism.description.parameter_names, len(mechanism.description.bodies)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], bodies)
    scales = dict(zip(names, np.repeat(1.0 + share * signs, 10).tolist(), strict=False))
    return np.array([scales.get(name, 1.0) for name in mechanism.parameter_names]) * mechanism.inertial_parameters
