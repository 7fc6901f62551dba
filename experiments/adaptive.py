"""Adaptive tracking with any arm: a built-in robot, or a file of yours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from adaptctl.control import Gains, PriorRanges
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import Learning, numbers
from adaptctl.recording import Setting
from adaptctl.recording.skeleton import skeleton

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class Adaptive(Learning):
    """The contest of `Learning` on any arm, with a reference drawn by seed and gains from its inertia."""

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = "{robot}: learning to track from knowing nothing"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .toml)")
    stiffness: float = setting(
        4.0, "damping K is this times the bandwidth times each joint's typical inertia", low=0.01, high=1e3
    )
    mass_range: float = setting(5.0, "prior range of masses, kg; lengths come from the arm's reach", low=1e-3, high=1e4)

    @property
    def purpose(self) -> str:
        """What is asked."""
        return (
            f"An arm follows sinusoids drawn by seed {self.seed} within its limits, and nobody tells the controller "
            "its inertial parameters. First those that its motion depends on are found, from energies alone. Then "
            "Slotine and Li's adaptive controller starts with estimates of zero and adapts only those."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """The tracking environment on a reference drawn by seed."""
        import gymnasium

        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=mechanism,
            reference=self.seed,
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
        )

    def gains(self, mechanism: Mechanism) -> Gains:
        """Lambda as set, K from each joint's typical inertia."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.stiffness)

    def ranges(self, mechanism: Mechanism) -> PriorRanges:
        """Masses as set, at about a third of the arm's reach."""
        lever = skeleton(mechanism).reach / 3.0
        return PriorRanges(self.mass_range, self.mass_range * lever, self.mass_range * lever**2)

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """The reference that was drawn."""
        env.reset(seed=self.seed)
        drawn = env.unwrapped.reference  # type: ignore[attr-defined]
        for name, unit in (("center", "rad"), ("amplitude", "rad"), ("frequency", "Hz")):
            yield Setting(f"reference {name}", numbers(getattr(drawn, name).ravel()), f"a joint each, {unit} (m)")
