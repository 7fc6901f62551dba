"""Every effect that the library offers, all but springs and bristles in one plant: for tests of what all of them do."""

from __future__ import annotations

from adaptctl.simulation.effects import (
    ActuatorLag,
    ControlDelay,
    Effect,
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    Friction,
    LuGre,
    PayloadHeld,
    TorqueLimit,
    TorqueRateLimit,
)

RIGID: list[Effect] = [
    FilteredDifferences(80.0),
    Encoder(1e-4, 2e-5, 1e-3),
    PayloadHeld(1.5, 0.02, 0.05),
    Friction(0.5, 1.0, 0.5),
    ActuatorLag(4e-3),
    TorqueRateLimit(5e3),
    TorqueLimit(60.0),
    ControlDelay(2),
]
"""Those that a plant of rigid joints has at once, in any order."""
EFFECTS: list[Effect] = [*RIGID, ElasticJoints(1e4), LuGre(1.0, 1e4)]
