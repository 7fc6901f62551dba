"""The search for a mechanism's null space: its settings, and what it finds, once that is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.methods import Method, Near

if TYPE_CHECKING:
    from adaptctl.identifiability.certification import CertifiedNullSpace


@dataclass(frozen=True, eq=False)
class Search:
    """The settings of a search for the null space of a mechanism's energies, the directions of its inertial parameters
    that change no energy, and its result, `found`, computed when that attribute is first read.

    `method` is "svd" (singular values of energies at random states), "transfers" (a tree's geometry, joint by joint) or
    "automatic": transfers for a tree of 100 parameters or more if they can certify the rank, else "svd". `samples` is
    the number of random states, `seed` draws them. `prove` True also computes the rank on exact geometry, False does
    not; None does so for trees, and for closed loops only where some geometry is nearly special: an angle within 1e-3
    rad of a multiple of 90 degrees, or an offset within 1e-4 of the characteristic length of zero or of another, that
    is not exact to 1e-11. `near` is for such geometry, unless `prove` is False: "refuse" makes `found` raise
    `RankError` if the rank would be another with these exact, "as_is" takes them as they stand.

    Nothing is checked at construction: reading `found` raises `RankError` where the rank cannot be certified or is
    refused, `InputError` for another `method` or `near`, for fewer than 2 `samples`, and for "transfers" of a mechanism
    with loops, constrained parameters, or drives that turn with several joints.
    """

    mechanism: Mechanism
    method: Method
    near: Near
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """The key under which results of this search are cached: a list of seven texts with all that they depend on.
        They are the SHA-256 hashes (hexadecimal) of the mechanism's description and of its geometry, which counts
        linear constraints on parameters, then the search's settings `method`, `near`, `prove`, `samples` and `seed`, as
        Python's repr writes them."""
        settings = self.method, self.near, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, self.mechanism.geometry_sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """The certified null space, a `CertifiedNullSpace`: the directions of the mechanism's inertial parameters that
        change no energy, the certificate of their number, its proof on exact geometry if there is one, and the energies
        behind them. Raises `RankError` where the rank cannot be certified or is refused, `InputError` for an unknown
        `method` or `near`, and for "transfers" where the mechanism has loops, constrained parameters, or drives that
        turn with several joints."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.near, self.prove, self.samples, self.seed)
