"""Task of arms of three freedoms: paths of a tip in space, and the arms that follow them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adaptctl.control import Gains, Sinusoids, Spline
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.experiments.ranged_gain import RangedGain
from adaptctl.recording import Setting

KNOT = 0.02
"""s between the samples that inverse kinematics turns into joints"""
AHEAD = 1.0
"""s beyond the end that a reference is asked for"""


@dataclass(frozen=True)
class ArmWithTip:
    """An arm of three degrees of freedom, the point that is its tip, and the positions where inverse kinematics
    starts."""

    name: str
    label: str
    robot: str
    link: str
    tip: tuple[float, float, float]
    """m, in that link's frame"""
    start: tuple[float, float, float]
    """rad, on the branch that is meant: elbow up, forearm ahead"""
    printed_rank: int
    """number of independent parameters in Table 13 of Sheu and Walker (1991)"""

    def on(self, mechanism: Mechanism) -> Tip:
        """Tip of this arm's mechanism. Raises InputError where it has no such link."""
        return Tip(mechanism, self.link, np.array(self.tip))


ARMS = (
    # The forearm to the flange, with the wrist held straight: d4 + d6 of the PUMA 560, along link 3's z axis.
    ArmWithTip("serial", "Three-joint PUMA", "puma560_arm3", "link3", (0.0, 0.0, 0.48935), (0.0, -1.5, 3.0), 16),
    # The forearm's end: 0.5 m past the elbow, which is 0.41 m from its frame.
    ArmWithTip("graph", "Five-bar", "semi_direct_drive", "link5", (0.91, 0.0, 0.0), (0.0, -1.5, -3.1), 26),
)


class TipPath(RangedGain):
    """Base class of experiments whose tip follows sinusoids in space, learned from zero; it names the settings
    below."""

    duration: float
    bandwidth: float
    stiffness: float
    center: tuple[float, ...]
    amplitude: tuple[float, ...]
    frequency: tuple[float, ...]
    phase: tuple[float, ...]
    start_time: float = 2.0

    @property
    def path(self) -> Sinusoids:
        """Desired path of the tip in the world, m."""
        center, amplitude, frequency = np.array(self.center), np.array(self.amplitude), np.array(self.frequency)
        return Sinusoids(center, amplitude, frequency, np.array(self.phase), self.start_time)

    def in_joints(self, tip: Tip, arm: ArmWithTip) -> Spline:
        """The path in joints, by inverse kinematics. Raises `InputError` where it is out of reach."""
        times = np.arange(0.0, self.duration + AHEAD + KNOT, KNOT)
        return Spline(tip.joints(self.path(times).p, np.array(arm.start)), times)

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop: Lambda as set, K from typical inertia."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.stiffness)

    def path_settings(self, tip: str) -> Iterator[Setting]:
        """Settings that state the path of what is called `tip`, and how it becomes joints."""
        law = "x(t) = centre + fade(t) · amplitude · sin(2π · frequency · t + phase)"
        yield Setting("path", law, f"of the {tip}, in the world")
        yield Setting("reference", f"spline of degree 5, knots every {KNOT:g} s", "in joints, by inverse kinematics")
