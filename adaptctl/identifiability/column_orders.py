"""Orders in which other tools write inertial parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from adaptctl.description.inertia import PARAMETERS
from adaptctl.errors import InputError, NotFoundError, printable, suggested_name

ORDERS: Mapping[str, Sequence[str]] = {
    "pinocchio": PARAMETERS,
    "figaroh": PARAMETERS,
    "mujoco": ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_yz", "I_xz"),
    "drake": ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz"),
}
"""Those of `Inertia.toDynamicParameters` in Pinocchio, of the columns of figaroh's torque regressor, of `pi` in
`mujoco.sysid`, and of `SpatialInertia` in Drake. In all of them products of inertia are entries of the tensor."""


def column_order(names: Sequence[str], tool: str, links: Sequence[str] = ()) -> list[int]:
    """Indices that bring parameters into the column order of a tool, with links in that tool's order; others last."""
    if tool not in ORDERS:
        raise NotFoundError(f"tool: expected one of {', '.join(ORDERS)}, got {printable(repr(tool))}")
    first = {name.removesuffix(".m"): i for i, name in enumerate(names) if name.endswith(".m")}
    kinds = [PARAMETERS.index(kind) for kind in ORDERS[tool]]
    bodies = [first[link] + kind for link in _each_once(links or list(first), first) for kind in kinds]
    return bodies + list(range(len(bodies), len(names)))


def _each_once(links: Sequence[str], known: Mapping[str, int]) -> Sequence[str]:
    for link in links:
        if link not in known:
            raise NotFoundError(f"links: unknown link {link!r}{suggested_name(link, known)}; links: {', '.join(known)}")
    if sorted(links) != sorted(known):
        raise InputError(f"links: expected each of {', '.join(known)} once, got {', '.join(links)}")
    return links
