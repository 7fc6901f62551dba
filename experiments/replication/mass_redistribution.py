"""Item of section 5.3: constraints on mass distribution, and the number of independent parameters they leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor, pseudo_inertia
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.replication.arms import SampledArm, semi_direct_drive
from adaptctl.experiments.replication.decoupling import Decoupling
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import (
    Claim,
    Evidence,
    Item,
    Outturn,
    Relations,
    compared,
    evidence,
)
from adaptctl.identifiability import fundamental_basis

THREE = 3
"""Relations that the paper counts, one for each off-diagonal term."""


@dataclass(frozen=True, eq=False)
class _Kind:
    """An arm of the two kinds of linkage, and what decouples it."""

    label: str
    arm: SampledArm
    needs: Decoupling


def section53(study: Study) -> Item:
    """Replication of section 5.3 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims):
    constraints on the mass distribution that make the off-diagonal entries of the mass matrix vanish. Computed are the
    number of relations among parameters that this takes, and the number of independent parameters that they leave,
    against the 23 printed. `study`, a `Study`, has the arms. Raises `RankError` where a number of identifiable
    parameters cannot be certified."""
    sayings, table = printed().claims, study.priority("table11", study.five_bar.mechanism)
    parallel = semi_direct_drive(load("semi_direct_drive_parallelogram"))
    generic = _Kind("generic", study.five_bar, Decoupling.of(study.five_bar, study.five_bar_basis))
    equal = _Kind("parallelogram", parallel, Decoupling.of(parallel, fundamental_basis(parallel.space, table)))
    under_three = _left_under(study.five_bar, THREE)
    saying = sayings["three_constraints"]
    return Item(
        "section5.3",
        "Decoupling the semi-direct-drive arm by mass redistribution",
        Outturn.ERRATUM,
        f"Any three independent relations make 26 into {under_three}, so the arithmetic holds. But three relations do "
        f"not make three off-diagonal inertias vanish: that takes {len(generic.needs.relations)} on a generic linkage, "
        f"leaving {generic.needs.left}, which no bodies with extent obey; and {len(equal.needs.relations)} on a "
        f"parallelogram, leaving {equal.needs.left}, and links that obey them exist.",
        chosen=(
            '"zero" means zero in every configuration within Table 9',
            "lengths: 0.45, 0.30, 0.37, 0.41 m; for the parallelogram 0.45 and 0.30 m twice",
        ),
        checks=(compared("independent parameters", "under three relations", saying.numbers, under_three),),
        claims=(
            Claim(
                saying,
                "relations that all three off-diagonal inertias ask for",
                f"{len(generic.needs.relations)} and {len(equal.needs.relations)}, not three; "
                f"{generic.needs.left} and {equal.needs.left} are left",
                Outturn.ERRATUM,
            ),
            _still_more(study, generic.needs.left, equal.needs.left),
        ),
        evidence=(*_alone(generic), *_alone(equal), *_impossible(generic), *_possible(equal)),
        relations=tuple(
            Relations(
                f"Every off-diagonal inertia vanishes: {kind.label}, {len(kind.needs.relations)} relations (a star: "
                "fundamental parameter)",
                kind.needs.lines(),
            )
            for kind in (generic, equal)
        ),
    )


def _still_more(study: Study, generic: int, equal: int) -> Claim:
    serial = study.arm3_space.rank
    return Claim(
        printed().claims["still_more"],
        "independent parameters of the decoupled arm against those of the three-joint PUMA",
        f"23 and {generic} are more than {serial}, but the decoupled parallelogram's {equal} are fewer",
        Outturn.ERRATUM if equal < serial else Outturn.REPRODUCED,
    )


def _left_under(arm: SampledArm, relations: int) -> int:
    """Rank that is left under random independent relations among the essential parameters."""
    random = np.random.default_rng(0).normal(size=(relations, arm.space.rank))
    _, _, right = np.linalg.svd(random)
    free = arm.space.basis @ right[relations:].T
    differences = np.diff(arm.energies(*arm.states(np.random.default_rng(1), 2 * arm.space.rank, 1.0)), axis=0)
    return int(np.linalg.matrix_rank(differences @ free, rtol=1e-9))


def _alone(kind: _Kind) -> tuple[Evidence, ...]:
    terms = list(kind.needs.per_term.items())
    names = [term for term, _ in terms]
    return (
        evidence(
            f"{kind.label.capitalize()}: {', '.join(names[:-1])} and {names[-1]} alone ask for {{}}, {{}} and {{}} "
            "relations, all together for {}.",
            *(n for _, n in terms),
            len(kind.needs.relations),
        ),
    )


def _impossible(kind: _Kind) -> tuple[Evidence, ...]:
    """The relations of a generic linkage add up to moments of inertia that would have to be zero."""
    rod, forearm = _length(kind.arm.mechanism, "link5"), _elbow(kind.arm.mechanism)
    moments = np.zeros(len(kind.arm.parameters))
    moments[30:40] = forearm**2 * _planar_moment(0.0)
    moments[40:50] = rod**2 * _planar_moment(forearm)
    relations = kind.needs.of_parameters()
    weights = np.linalg.lstsq(relations.T, moments)[0]
    return (
        evidence(
            "The generic relations add up to l5² I4 + l4² I5 = 0, I4 the moment of link 4 about joint 4 and I5 that of "
            "link 5 about the elbow (off by {}). Only points at those two places obey that.",
            np.abs(relations.T @ weights - moments).max(),
            digits=1,
        ),
        evidence("The built-in arm's l5² I4 + l4² I5 is {} kg m⁴.", float(moments @ kind.arm.parameters)),
    )


def _possible(kind: _Kind) -> tuple[Evidence, ...]:
    """Links that obey the parallelogram's relations: rods in one plane, the forearm's centre in its place."""
    mechanism = kind.arm.mechanism.with_parameters(_decoupled(kind.arm.mechanism))
    p, _ = kind.arm.states(np.random.default_rng(2), 100, 1.0)
    M = mechanism.mass_matrix(p)
    off = np.abs(M[:, [0, 0, 1], [1, 2, 2]])
    vary = float(np.ptp(M[:, [1, 2], [1, 2]], axis=0).max())
    lowest = min(float(np.linalg.eigvalsh(pseudo_inertia(link.inertia))[0]) for link in mechanism.links)
    return (
        evidence(
            "A parallelogram that is decoupled: the built-in one with its links in one plane and the forearm's centre "
            "of mass moved to {} m from its joint. Its links are rigid bodies (smallest eigenvalue of a pseudo-inertia "
            "{}).",
            mechanism.links[4].inertia[1] / mechanism.links[4].inertia[0],
            lowest,
        ),
        evidence(
            "Its largest off-diagonal inertia is {} kg m², and M22 and M33 vary by {} kg m² over the range: it is "
            "configuration-invariant too.",
            off.max(),
            vary,
            digits=1,
        ),
    )


def _decoupled(mechanism: Mechanism) -> Array:
    """Parameters (P,) of a decoupled parallelogram: no offsets from the plane, m5 (c5 - l3) = (l3/l2) m4 c4."""
    tens = mechanism.inertial_parameters.reshape(-1, 10).copy()
    upper, crank = _length(mechanism, "link5"), _length(mechanism, "link4")
    for ten in tens[1:]:
        _move(ten, ten[1] / ten[0])
    _move(tens[4], crank + crank / upper * tens[3, 1] / tens[4, 0])
    return tens.ravel()


def _move(ten: Array, place: float) -> None:
    """Move a body's centre of mass onto its link's x axis, its tensor there unchanged."""
    mass, center = ten[0], ten[1:4] / ten[0]
    tensor = inertia_tensor(ten) - mass * (center @ center * np.eye(3) - np.outer(center, center))
    ten[:] = from_center_of_mass(mass, np.array([place, 0.0, 0.0]), tensor)


def _planar_moment(place: float) -> Array:
    """The ten coefficients of the integral of (x - place)² + y²."""
    return np.array([place**2, -2.0 * place, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def _length(mechanism: Mechanism, behind: str) -> float:
    """Distance (m) from the joint before a link's joint to it."""
    return float(next(link for link in mechanism.links if link.name == behind).near.translation[0])


def _elbow(mechanism: Mechanism) -> float:
    """Position of the elbow on link 5 (m)."""
    loops = mechanism.description.loops
    return float(loops.closures[0].second_frame.translation[0]) if loops else 0.0
