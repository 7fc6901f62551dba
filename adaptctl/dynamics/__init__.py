"""The equations of motion, written once over scalars, and `Mechanism`, their face on arrays."""

from adaptctl.dynamics.mechanism import Mechanism, load

__all__ = ["Mechanism", "load"]
