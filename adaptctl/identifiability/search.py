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
    """The settings of a search for the null space of a mechanism's energies, and its result, found when first asked
    for.

    `method` is "automatic", "svd" (singular values of energies at random states) or "transfers" (a tree's geometry);
    `near` is for angles and lengths that are nearly, but not exactly, special, such as right angles: "refuse" raises
    where the rank would be another if they were exact, "as_is" takes them as they stand; `prove` says whether the rank
    is also computed on exact geometry, None that it is unless loops are closed and nothing is nearly special. `samples`
    is the number of random states, `seed` draws them. Nothing is checked at construction, but when `found` is asked
    for.
    """

    mechanism: Mechanism
    method: Method
    near: Near
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """All that the search's result depends on, as a list of seven texts: the SHA-256 hashes (hexadecimal) of the
        mechanism's description and of its geometry, which counts linear constraints on parameters, then the search's
        settings `method`, `near`, `prove`, `samples` and `seed`, as Python's repr writes them. It is the key under
        which results are cached."""
        settings = self.method, self.near, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, self.mechanism.geometry_sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """The certified null space: the directions of the mechanism's inertial parameters that change no energy, the
        certificate of their number, its proof on exact geometry if there is one, and the energies behind them. Raises
        `RankError` where the rank cannot be certified or is refused, `InputError` for an unknown `method` or `near`,
        and for "transfers" where the mechanism is no plain tree."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.near, self.prove, self.samples, self.seed)
