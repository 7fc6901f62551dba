"""The rank of random arms, found from energies and joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from adaptctl.description import Description, Joint, JointKind, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.experiment import setting
from adaptctl.identifiability import essential_space
from adaptctl.sweeps.measurement import SweepMeasurement
from adaptctl.sweeps.outcome import FAILURES, RunOutcome

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class RankCertificate(SweepMeasurement):
    """Measurement of the rank, the number of identifiable parameters, of a random serial chain of `links` links: the
    rank that the singular values of its energies certify, against the rank that follows from its joints one by one. The
    run is "done" where they are equal, and "failed" where they are not, or where no rank can be certified.

    `prismatic` is the probability that a joint is prismatic; `aligned` is each of three probabilities: that a joint's
    axis is one of the axes of its frame, that the frame is turned against the one before by a multiple of a right angle
    about such an axis, and that a coordinate of the offset between the frames is zero. The chain is drawn by `seed`.
    Raises `InputError` at construction for settings of another type or out of their bounds, `NonFiniteError` for NaN or
    infinity.
    """

    name: ClassVar[str] = "rank-certificate"

    links: int = setting(6, "links of the chain", low=1, high=40)
    prismatic: float = setting(0.25, "share of joints that slide", low=0.0, high=1.0)
    aligned: float = setting(
        0.7, "share of axes and twists at right angles, and of offsets that are zero", low=0.0, high=1.0
    )

    @classmethod
    def outcomes(cls, chosen: Sequence[Self]) -> list[RunOutcome]:
        """List of the `RunOutcome` of each of the measurements `chosen`, in their order: "done" where the chain's rank,
        the number of its identifiable parameters, is the same from energies as from its joints one by one, else
        "failed". Its reason has both ranks, or the error. An `AdaptctlError`, an `ArithmeticError` or NumPy's
        `LinAlgError` is never raised."""
        return [one._judged() for one in chosen]

    def mechanism(self) -> Mechanism:
        """The `Mechanism` whose rank is certified: a serial chain of `links` links with random frames, joints and
        inertias, the same for the same settings and seed. Nothing is raised."""
        rng = np.random.default_rng([self.seed, self.links])
        return Mechanism(Description("chain", tuple(self._link(rng, i) for i in range(self.links)), GRAVITY))

    def _judged(self) -> RunOutcome:
        try:
            mechanism = self.mechanism()
            ranks = [essential_space(mechanism, method=method).rank for method in ("svd", "transfers")]
        except FAILURES as error:
            return RunOutcome.failed(error)
        words = f"rank {ranks[0]} from energies, {ranks[1]} from joints"
        return RunOutcome("done", words) if ranks[0] == ranks[1] else RunOutcome.failed(words)

    def _link(self, rng: np.random.Generator, i: int) -> Link:
        kind = JointKind.PRISMATIC if rng.random() < self.prismatic else JointKind.REVOLUTE
        axis = np.eye(3)[rng.integers(3)] if rng.random() < self.aligned else _direction(rng)
        points, masses = rng.uniform(-0.2, 0.2, (5, 3)), rng.uniform(0.2, 1.0, 5)
        bodies = [from_center_of_mass(m, c, np.zeros((3, 3))) for m, c in zip(masses, points, strict=True)]
        joint, inertia = Joint(f"joint{i + 1}", kind, axis), np.sum(bodies, axis=0)
        return Link(f"link{i + 1}", i - 1, joint, self._pose(rng), Pose.identity(), inertia)

    def _pose(self, rng: np.random.Generator) -> Pose:
        aligned = rng.random() < self.aligned
        turn = float(rng.integers(4)) * np.pi / 2.0 if aligned else rng.uniform(-np.pi, np.pi)
        about = np.eye(3)[rng.integers(3)] if aligned else _direction(rng)
        offsets = np.where(rng.random(3) < self.aligned, 0.0, rng.uniform(-0.5, 0.5, 3))
        return Pose(rotation_about(about, turn), offsets)


def _direction(rng: np.random.Generator) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))
