"""Task of arms of three freedoms: paths of a tip in space, and the arms that follow them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, PriorRanges, Sinusoids, Spline, adaptation_gain
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import Setting

KNOT = 0.02
"""s between the samples that inverse kinematics turns into joints"""
AHEAD = 1.0
"""s beyond the end that a reference is asked for"""


@dataclass(frozen=True)
class ArmWithTip:
    """Arm of three degrees of freedom and the point on it, its tip, that is to follow a path: `name`, short and fit for
    a file; `label`, for legends; `robot`, the built-in's name; `link`, the name of the tip's link, and `tip`, the point
    (x, y, z), m, in that link's frame; `start`, joint positions (rad) from which inverse kinematics starts, which
    select one of its solutions, such as elbow up; and `printed_rank`, the number of independent parameters in Table 13
    of Sheu and Walker (1991). Nothing is checked at construction."""

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
        """Tip of this arm on a `mechanism`, a `Tip`: a point fixed to the link that the field `link` names. Raises
        `InputError` where the mechanism has no such link."""
        return Tip(mechanism, self.link, np.array(self.tip))


ARMS = (
    # The forearm to the flange, with the wrist held straight: d4 + d6 of the PUMA 560, along link 3's z axis.
    ArmWithTip("serial", "Three-joint PUMA", "puma560_arm3", "link3", (0.0, 0.0, 0.48935), (0.0, -1.5, 3.0), 16),
    # The forearm's end: 0.5 m past the elbow, which is 0.41 m from its frame.
    ArmWithTip("graph", "Five-bar", "semi_direct_drive", "link5", (0.91, 0.0, 0.0), (0.0, -1.5, -3.1), 26),
)


class TipPath:
    """Base class of experiments in which an arm's tip follows a sinusoid along each world axis and its controllers
    learn from zero initial estimates of the parameters. `center`, `amplitude` (m), `frequency` (Hz) and `phase` (rad)
    have three entries, x, y and z; `duration` (s) is the run's, `start_time` (s) that of the smooth start, 2 s by
    default. `bandwidth` (1/s) is the rate at which errors decay. Each joint's damping is K = `stiffness` `bandwidth` I,
    `stiffness` having no unit and I being the joint's typical inertia, the median of its entry of the mass matrix's
    diagonal over 200 random configurations. A subclass has these as settings (`start_time` where it is to be one),
    besides `mass_range`, `first_moment_range`, `inertia_range` and `rate` for the adaptation gain. Nothing is checked
    at construction."""

    duration: float
    bandwidth: float
    stiffness: float
    center: tuple[float, ...]
    amplitude: tuple[float, ...]
    frequency: tuple[float, ...]
    phase: tuple[float, ...]
    start_time: float = 2.0
    rate: float
    mass_range: float
    first_moment_range: float
    inertia_range: float

    @property
    def path(self) -> Sinusoids:
        """Desired path of the arm's tip in the world, a `Sinusoids`: a function of T times (T,), s, that gives
        positions x, y, z in m, velocities in m/s and accelerations in m/s^2, (T, 3) each. Raises `InputError` for
        settings of different lengths or not finite."""
        center, amplitude, frequency = np.array(self.center), np.array(self.amplitude), np.array(self.frequency)
        return Sinusoids(center, amplitude, frequency, np.array(self.phase), self.start_time)

    def in_joints(self, tip: Tip, arm: ArmWithTip) -> Spline:
        """Reference of the arm's three joints, a `Spline` of positions in rad, that moves its tip along the path, by
        inverse kinematics every 0.02 s and a spline of degree 5 through these, from 0 to 1 s after the run's
        `duration`. `tip` is the point that follows the path; `arm` gives the joint positions where inverse kinematics
        starts. Raises `InputError` for a path that is out of reach or passes a singularity."""
        times = np.arange(0.0, self.duration + AHEAD + KNOT, KNOT)
        return Spline(tip.joints(self.path(times).p, np.array(arm.start)), times)

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop, a `Gains`, for the r primary (independently moving) joints of a `mechanism`:
        Lambda (r,), 1/s, this object's `bandwidth`, and K (r,), N m s/rad (N s/m if prismatic), `stiffness` times
        Lambda times the joint's typical inertia, the median of its entry of the mass matrix's diagonal over 200 random
        configurations. Raises `InputError` where a joint's typical inertia is not positive."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.stiffness)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain for a `model`'s k parameters: `rate` times the squared prior ranges of
        masses, first moments and inertias. Raises `InputError` for ranges or a rate that are not positive and
        finite."""
        return adaptation_gain(
            model, PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range), self.rate
        )

    def path_settings(self, tip: str) -> Iterator[Setting]:
        """Iterator over settings for the report, a `Setting` (name, value and meaning) each, that state the path's
        formula and how it is turned into joint positions. `tip` is the word for the point that follows it, such as
        "tool". Nothing is checked."""
        law = "x(t) = centre + fade(t) · amplitude · sin(2π · frequency · t + phase)"
        yield Setting("path", law, f"of the {tip}, in the world")
        yield Setting("reference", f"spline of degree 5, knots every {KNOT:g} s", "in joints, by inverse kinematics")
