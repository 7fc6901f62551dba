"""The offline stage: the parameters that matter, with the certificate of their number, and those of long chains."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

import adaptctl
from adaptctl.errors import PhysicalConsistencyWarning
from adaptctl.identifiability import essential_space
from adaptctl.identifiability.transferred_null_space import TransferredNullSpace
from adaptctl.mechanism import Description, Joint, Link, Pose
from adaptctl.mechanism.inertia import from_center_of_mass
from benchmarks.findings import Finding, Measurement
from benchmarks.interleaved import Contender, Effort, Spread, race

LONG, HALF = 96, 48
"""links"""


def measure(effort: Effort) -> Iterator[Finding]:
    """The PUMA, and chains in turns, whose times tell how they grow."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicalConsistencyWarning)
        puma = adaptctl.load("puma560")
    half, long = chain(HALF), chain(LONG)
    raced = race(
        {
            "puma": Contender(lambda: essential_space(puma)),
            "half": Contender(lambda: TransferredNullSpace.of(half)),
            "long": Contender(lambda: TransferredNullSpace.of(long)),
            "certified": Contender(lambda: essential_space(long)),
        },
        effort,
    )
    growth = Spread.of(np.log2(raced.seconds["long"] / raced.seconds["half"]) / np.log2(LONG / HALF))
    yield Measurement("essential space of the PUMA, with its certificate", raced.time("puma"), "s", 0.010)
    yield Measurement(f"null vectors of a chain of {LONG} links", raced.time("long"), "s", 0.025)
    yield Measurement(f"exponent of its growth, from {HALF} links to {LONG}", growth, "", 1.3)
    yield Measurement("essential space of that chain, with its certificate", raced.time("certified"), "s", None)


def chain(links: int) -> adaptctl.Mechanism:
    """Equal links in a row, whose joints turn about z, y, x, y and so on."""
    inertia = from_center_of_mass(1.0, [0.1, 0.02, 0.01], 0.01 * np.eye(3))
    near, far = Pose(np.eye(3), np.array([0.2, 0.0, 0.1])), Pose.identity()
    axes = np.eye(3)[[2, 1, 0, 1]]
    joints = [Joint(f"joint{i}", axis=axes[i % 4]) for i in range(links)]
    row = tuple(Link(f"link{i}", i - 1, joint, near, far, inertia) for i, joint in enumerate(joints))
    return adaptctl.Mechanism(Description(f"{links} links", row))
