"""Stored excitation, and excitation in quarantine."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.control.adaptation.symmetric import scaled
from adaptctl.scalars import Scalar

QUARANTINE = 0.3
"""s, mean time from a sample to the memory, so that a contact that is detected is forgotten"""


class Stored(NamedTuple):
    """Information and z of memory and of quarantine, in units of the initial gain."""

    information: Any
    known: Any
    pending: Any
    pending_known: Any

    def cleared(self, kept: Scalar, pending: Scalar) -> Stored:
        """The same times factors of the memory and of quarantine."""
        return Stored(
            scaled(self.information, kept),
            kept * self.known,
            scaled(self.pending, pending),
            pending * self.pending_known,
        )
