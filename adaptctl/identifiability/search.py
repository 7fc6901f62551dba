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
    """The settings of a search, on which all that it finds depends."""

    mechanism: Mechanism
    method: Method
    near: Near
    prove: bool | None
    samples: int
    seed: int

    @cached_property
    def inputs(self) -> list[str]:
        """The mechanism's hash and the settings, in JSON's types."""
        settings = self.method, self.near, self.prove, self.samples, self.seed
        return [self.mechanism.description.sha256, *map(repr, settings)]

    @cached_property
    def found(self) -> CertifiedNullSpace:
        """The null space, its certificate, its proof and the energies behind them. Raises as `certified` does."""
        from adaptctl.identifiability.certification import certified  # a tenth of the time to the first torque

        return certified(self.mechanism, self.method, self.near, self.prove, self.samples, self.seed)
