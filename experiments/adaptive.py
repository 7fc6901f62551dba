"""Adaptive tracking with any arm: a built-in robot, or a file of yours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, PriorRanges, sampled_gain, typical_inertia
from adaptctl.control.gains.torque_limits import finite_torque_limits
from adaptctl.description import GROUND
from adaptctl.description.reach import reach_behind
from adaptctl.dynamics import Mechanism
from adaptctl.envs.random_reference import random_sinusoids
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import Learning, numbers
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import Setting

if TYPE_CHECKING:
    import gymnasium

SMALLEST_ERROR = 1e-2
"""rad or m: smaller initial errors than this are taken as this when gains are chosen"""
SAMPLED_GAIN, LARGEST_SAMPLED_GAIN = 0.5, 1.0
"""of T_c lambda_max(M^-1 K), for one joint alone and for all together; stable below 2"""
LARGEST_ADAPTATION = 0.2
"""of T_c lambda_max(K^-1 Y_r Gamma Y_r'); stable below 1"""
REFERENCE_SAMPLES = 200
SHORTEST_LEVER = 0.05
"""m, behind a last joint"""


@dataclass(frozen=True)
class AdaptiveTracking(Learning):
    """The contest of `Learning` on any arm, with a reference drawn by seed and gains from its inertia."""

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = "{robot}: learning to track from knowing nothing"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .xml, .toml)")
    effort: float = setting(
        0.6, "damping K asks for this share of the torque limit at the initial error", symbol="K", low=0.01, high=1.0
    )

    heaviest: float = setting(5.0, "the greatest prior range of a link's mass, kg", low=1e-3, high=1e4)

    @property
    def purpose(self) -> str:
        """Question that the experiment answers, in a paragraph."""
        return (
            f"An arm follows sinusoids drawn by seed {self.seed} within its limits, and nobody tells the controller "
            "its inertial parameters. First those that its motion depends on are found, from energies alone. Then "
            "Slotine and Li's adaptive controller starts with estimates of zero and adapts only those."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment on a reference drawn by seed."""
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
        """Gains: Lambda as set; K from the torque limits, as far as inertia and control period carry it."""
        first_sliding = self.bandwidth * max(abs(self.initial_error), SMALLEST_ERROR)
        affordable = self.effort * finite_torque_limits(mechanism) / first_sliding
        carried = SAMPLED_GAIN * typical_inertia(mechanism) / self.control_period
        damping = np.minimum(affordable, carried)
        excess = sampled_gain(mechanism, damping, self.control_period) / LARGEST_SAMPLED_GAIN
        return Gains(np.full(mechanism.dof, self.bandwidth), damping / max(1.0, excess))

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of Gamma from each link's prior ranges, no larger than the control period carries."""
        return self._carried_rate(model.mechanism) * _link_ranges(model, self.heaviest) ** 2

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Gamma in words."""
        return f"{self._carried_rate(mechanism):.3g} × (range)², ranges from each joint's typical inertia and reach"

    def _carried_rate(self, mechanism: Mechanism) -> float:
        """Adaptation rate: as set, or less, so that T_c lambda_max(K^-1 Y_r Gamma Y_r') stays well below 1."""
        full, rng = ReducedModel.full(mechanism), np.random.default_rng(self.seed)
        reference = random_sinusoids(mechanism, rng)(np.linspace(0.0, self.duration, REFERENCE_SAMPLES))
        off = self.initial_error * rng.choice([-1.0, 1.0], reference.p.shape)
        v_r, a_r = reference.v - self.bandwidth * off, reference.a + self.bandwidth**2 * off
        regressor = mechanism.slotine_li_regressor(reference.p + off, reference.v, v_r, a_r)
        scaled = regressor * _link_ranges(full, self.heaviest) / np.sqrt(self.gains(mechanism).damping)[:, None]
        largest = float(np.linalg.norm(scaled, ord=2, axis=(-2, -1)).max()) ** 2
        return min(self.rate, LARGEST_ADAPTATION / (self.control_period * largest))

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Settings that state the reference that was drawn."""
        env.reset(seed=self.seed)
        drawn = env.unwrapped.reference  # type: ignore[attr-defined]
        for name, unit in (("center", "rad"), ("amplitude", "rad"), ("frequency", "Hz")):
            yield Setting(f"reference {name}", numbers(getattr(drawn, name).ravel()), f"a joint each, {unit} (m)")


def _link_ranges(model: ReducedModel, heaviest: float) -> Array:
    """Prior ranges (k,) of a model's parameters: a link's from its joint's typical inertia and the reach behind it.

    Of that inertia I, a body at a third of what is left of the arm's reach has the mass m = I/lever^2, which is
    at most `heaviest` (kg), and the first moment sqrt(m I).
    """
    mechanism = model.mechanism
    inertia = _behind(mechanism)
    levers = np.maximum(reach_behind(mechanism.links), SHORTEST_LEVER) / 3.0
    masses = np.minimum(inertia / levers**2, heaviest)
    by_owner: dict[str, PriorRanges] = {}
    for link, mass, moment in zip(mechanism.links, masses.tolist(), inertia.tolist(), strict=True):
        # A link owns its ten, its joint the drive's.
        by_owner[link.name] = by_owner[link.joint.name] = PriorRanges(mass, float(np.sqrt(mass * moment)), moment)
    return np.concatenate([by_owner[name.rpartition(".")[0]].of((name,)) for name in model.names])


def _behind(mechanism: Mechanism) -> Array:
    """Typical inertia (N,) that the nearest driven joint at or before each link moves."""
    of_joints = dict(zip(mechanism.description.primary, typical_inertia(mechanism).tolist(), strict=True))
    found: list[float] = []
    for i, link in enumerate(mechanism.links):
        before = found[link.parent] if link.parent != GROUND else max(of_joints.values())
        found.append(of_joints.get(i, before))
    return np.array(found)
