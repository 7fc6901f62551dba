"""Links that are not what their description says."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism


def scaled_links(mechanism: Mechanism, share: float, seed: int) -> Array:
    """Inertial parameters (P,) with every link's ten scaled up or down by a share, by seed: a rigid body stays one, and
    drives stay as they are."""
    bodies = len(mechanism.description.bodies)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], bodies)
    scales = np.ones(len(mechanism.parameter_names))
    scales[: 10 * bodies] = np.repeat(1.0 + share * signs, 10)
    return scales * mechanism.inertial_parameters
