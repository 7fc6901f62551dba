"""The offline stage: the parameters that matter, with the certificate of their number, and those of long chains."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description import Description, Joint, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import PhysicalConsistencyWarning
from adaptctl.identifiability import Priority
from adaptctl.identifiability.certification import CertifiedNullSpace
from adaptctl.identifiability.essential_space import Search
from adaptctl.identifiability.tree_null_space import TreeNullSpace
from benchmarks.findings import Finding, Measurement
from benchmarks.interleaved import Effort, Race, Spread, Statement, race

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
            "puma": Statement(lambda: certified(puma)),
            "half": Statement(lambda: TreeNullSpace.of(half)),
            "long": Statement(lambda: TreeNullSpace.of(long)),
            "half basis": Statement(lambda: basis(half)),
            "long basis": Statement(lambda: basis(long)),
            "certified": Statement(lambda: certified(long)),
        },
        effort,
    )
    yield Measurement("essential space of the PUMA, with its certificate", raced.time("puma"), "s", 0.006)
    yield Measurement(f"null vectors of a chain of {LONG} links", raced.time("long"), "s", 0.025)
    yield Measurement(f"exponent of its growth, from {HALF} links to {LONG}", growth(raced, "half", "long"), "", 1.3)
    whole = "null vectors, kept parameters and regrouping matrix"
    yield Measurement(f"{whole} of that chain", raced.time("long basis"), "s", 0.025)
    yield Measurement(
        "exponent of its growth, the matrix being dense", growth(raced, "half basis", "long basis"), "", None
    )
    yield Measurement("essential space of that chain, with its certificate", raced.time("certified"), "s", None)


def growth(raced: Race, half: str, long: str) -> Spread:
    """The power of the number of links that the time goes with."""
    return Spread.of(np.log2(raced.seconds[long] / raced.seconds[half]) / np.log2(LONG / HALF))


def certified(mechanism: adaptctl.Mechanism) -> CertifiedNullSpace:
    """The search behind `essential_space`, which an earlier process may have spared it."""
    return Search(mechanism, "automatic", False, None, 2 * mechanism.num_energy_parameters + 1, 0).found


def basis(mechanism: adaptctl.Mechanism) -> Array:
    """K (k, P) of a tree, from its description; what `fundamental_basis` has besides is in the certificate."""
    found = TreeNullSpace.of(mechanism)
    order = Priority().indices(mechanism.parameter_names)
    return found.regrouping(order, 1e-3).matrix(found.scales)


def chain(links: int) -> adaptctl.Mechanism:
    """Equal links in a row, whose joints turn about z, y, x, y and so on."""
    inertia = from_center_of_mass(1.0, [0.1, 0.02, 0.01], 0.01 * np.eye(3))
    near, far = Pose(np.eye(3), np.array([0.2, 0.0, 0.1])), Pose.identity()
    axes = np.eye(3)[[2, 1, 0, 1]]
    joints = [Joint(f"joint{i}", axis=axes[i % 4]) for i in range(links)]
    row = tuple(Link(f"link{i}", i - 1, joint, near, far, inertia) for i, joint in enumerate(joints))
    return adaptctl.Mechanism(Description(f"{links} links", row))
