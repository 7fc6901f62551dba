"""Prior links: the robot's file, made physically consistent, before any log is read."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

DENSITY = 2700.0
"""kg/m^3, aluminium: a link is spread at least as far as a ball of it."""


def prior_links(mechanism: Mechanism) -> tuple[Array, list[str]]:
    """The inertial parameters (N, 10) of a mechanism's N links, those not declared massless, in their order, as guessed
    before any log is read; and a list of remarks, as text, on links that were changed. A link's ten are m (kg), mc_x,
    mc_y, mc_z (kg m), I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about its frame's origin.

    They are the mechanism's own, but physically consistent. A link is changed where its least principal second moment
    of mass about its centre is below 1 % of that of a solid aluminium ball of the same mass, as in files without
    inertia tensors: each principal second moment below the ball's is then set to the ball's. Raises `InputError` for a
    link without mass that is not declared massless.
    """
    tens, remarks = [], []
    for i in mechanism.description.bodies:
        link = mechanism.links[i]
        ten = link.inertia
        if not ten[0] > 0.0:
            raise InputError(
                f"{mechanism.name}: link {link.name!r} has no mass in the robot's file; the estimate needs a guess of "
                "every link: give it a mass, a centre and an inertia, roughly"
            )
        spread = _spread_enough(ten)
        if not np.array_equal(spread, ten):
            remarks.append(
                f"{link.name}: no body has its inertia in the robot's file; taken at least as that of a ball of "
                "aluminium of its mass"
            )
        tens.append(spread)
    return np.stack(tens), remarks


def _spread_enough(ten: Array) -> Array:
    """The ten with principal second moments about the centre of at least those of a ball."""
    mass, center = float(ten[0]), ten[1:4] / ten[0]
    at_origin = 0.5 * np.trace(inertia_tensor(ten)) * np.eye(3) - inertia_tensor(ten)
    values, axes = np.linalg.eigh(at_origin - mass * np.outer(center, center))
    least = 0.2 * mass * (3.0 * mass / (4.0 * np.pi * DENSITY)) ** (2.0 / 3.0)
    if values[0] >= 0.01 * least:
        return ten
    moments = axes @ np.diag(np.maximum(values, least)) @ axes.T
    return from_center_of_mass(mass, center, np.trace(moments) * np.eye(3) - moments)
