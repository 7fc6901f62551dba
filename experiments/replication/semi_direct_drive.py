"""Computations of the semi-direct-drive arm's tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor, pseudo_inertia
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication.arms import Arm, Study, index, near_parallelogram, paper_rank
from adaptctl.experiments.replication.judging import Computation, checked, inside, percent
from adaptctl.experiments.replication.puma560 import QUARTER, QUARTERS, drawn_torque_errors, torque_figure
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.identifiability.energy_matrix import NumericalRank, energies
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.regrouping import removable
from adaptctl.identifiability.sampling import random_states

NEGLIGIBLE = 1e-9
"""Of the largest: what lies below is round-off."""


def table9(study: Study) -> Computation:
    """Table 9: the semi-direct-drive arm's ranges against the built-in arm's."""
    mechanism, (lower, upper, _) = study.five_bar.mechanism, study.five_bar.box[:, 2]
    p, closed = np.zeros((200, 3)), mechanism.continuation
    p[:, 2] = -np.linspace(lower, upper, 200)
    regular = closed.regularity(mechanism.configuration(p)).min() if closed else 1.0
    return Computation(
        {"regular": regular, "lower": np.degrees(lower), "upper": np.degrees(upper)}, study.five_bar.limit
    )


def table10(study: Study) -> Computation:
    """Table 10: the semi-direct-drive arm's errors by the number of components."""
    arm, table, generic = study.nearly_parallel, study.paper.items["table10"], study.five_bar
    fewest, share = arm.fewest(study.said("arm_torque"))
    lie, others = inside(checked(table, arm.error)), inside(checked(table, generic.error))
    tilted = Arm(study, with_base_tilt(generic.mechanism, QUARTERS[QUARTER]))
    _, values, right = np.linalg.svd(tilted.differences[0])
    rank = int(paper_rank(np.asarray(values)))
    missing = right[:rank].T @ (right[:rank] @ tilted.parameters) - tilted.parameters
    return Computation(
        {
            "fewest": fewest,
            "outside": len(list(table.entries())) - lie,
            "other": others,
            "quarter": QUARTER,
            "rest": np.median(arm.torque_errors[:, -1, 0]),
            "tilted_rank": rank,
            "tilted_error": float(np.mean((tilted.motion.Y[:, 0] @ missing) ** 2)),
        },
        arm.error,
        {"arm_torque": share},
        drawings=[drawn_torque_errors("table-10", arm, table)],
    )


def with_base_tilt(mechanism: Mechanism, quarter: float) -> Mechanism:
    """Copy of the arm, its first frame turned about x by minus `quarter` (rad)."""
    first = mechanism.links[0]
    base = replace(first, parent_to_joint=Pose(rotation_about((1, 0, 0), -quarter), first.parent_to_joint.translation))
    return Mechanism(replace(mechanism.description, links=(base, *mechanism.links[1:])))


def figure6(study: Study) -> Computation:
    """Figure 6: the torque of the semi-direct-drive arm's second joint with 10, 20 and 26 components."""
    return torque_figure(study.nearly_parallel, "figure-6", 2, (10, 20, 26))


def table11(study: Study) -> Computation:
    """Table 11: the order in which the other arm's parameters are removed, against the default one."""
    return Computation(entry=study.five_bar.places)


def table12(study: Study) -> Computation:
    """Table 12: the semi-direct-drive arm's set of independent parameters."""
    space, basis = study.five_bar.space, study.five_bar.basis
    once = replace(study, seeds=1)
    near = {n: Arm(once, near_parallelogram(10.0**-n)).differences[0] for n in (3, 5, 7, 9)}
    ranks = {f"rank{n}": paper_rank(singular_values(differences)) for n, differences in near.items()}
    certified = {"certified": space.rank, "kept": basis.rank, "gap": space.certificate.gap}
    return Computation(
        {**certified, **ranks, "parallelogram": study.parallelogram.space.rank},
        lambda row, link: index(row, link) in basis.columns,
        {
            "arm_independent": space.rank == basis.rank == study.said("arm_independent"),
            "arm_rank": study.five_bar.rank_share("arm_rank"),
        },
    )


def table13(study: Study) -> Computation:
    """Table 13: numbers of links, joints and parameters of both arms."""
    space, arm, columns = study.arm3.space, study.five_bar, study.paper.items["table13"].columns
    counts = dict(zip(columns, (_counts(study.arm3), _counts(arm)), strict=True))
    E = arm.mechanism.energy_regressor(*arm.states(np.random.default_rng(study.seed), 4 * len(arm.parameters), 1.0))
    return Computation(
        {
            "rank": space.rank,
            "undifferenced": undifferenced(study.arm3),
            "torque_rank": space.certificate.rank_torque or 0,
            "gap": space.certificate.gap,
            "whole": undifferenced(study.puma),
            "loop": NumericalRank.from_singular_values(singular_values(E * arm.space.scales)).rank,
        },
        lambda row, column: counts[column][row],
    )


def undifferenced(arm: Arm) -> int:
    """Rank of an `arm`'s energies without differences."""
    states = random_states(arm.mechanism, 4 * len(arm.parameters), np.random.default_rng(0))
    return NumericalRank.from_singular_values(singular_values(energies(arm.mechanism, states) * arm.space.scales)).rank


def _counts(arm: Arm) -> Mapping[str, float]:
    mechanism, loops = arm.mechanism, arm.mechanism.description.loops
    return {
        "links": len(mechanism.links),
        "joints": len(mechanism.links) + (len(loops.closures) if loops else 0),
        "primary joints": mechanism.dof,
        "actuators": mechanism.dof,
        "dimension of essential space": arm.space.rank,
        "inertial parameters": len(mechanism.parameter_names),
    }


def section53(study: Study) -> Computation:
    """Section 5.3: relations that make the off-diagonal entries of the mass matrix vanish."""
    arms = {"Generic": study.five_bar, "Parallelogram": study.parallelogram}
    bases = (study.five_bar.basis, fundamental_basis(study.parallelogram.space, study.five_bar.order))
    needs = {key: Decoupling.of(arms[key], basis) for key, basis in zip(arms, bases, strict=True)}
    generic, equal = needs.values()
    under, serial = left_under(study.five_bar, 3), study.arm3.space.rank
    off, moments = impossible_moments(study.five_bar.mechanism, generic)
    possible = decoupled(study.parallelogram.mechanism)
    M = possible.mass_matrix(study.parallelogram.states(np.random.default_rng(2), 100, 1.0)[0])
    forearm = possible.links[4].inertia
    return Computation(
        {
            "under": under,
            "serial": serial,
            "generic": len(generic.relations),
            "generic_left": generic.left,
            "equal": len(equal.relations),
            "equal_left": equal.left,
            "off": off,
            "moments": moments,
            "place": forearm[1] / forearm[0],
            "lowest": min(float(np.linalg.eigvalsh(pseudo_inertia(link.inertia))[0]) for link in possible.links),
            "off_diagonal": np.abs(M[:, [0, 0, 1], [1, 2, 2]]).max(),
            "vary": float(np.ptp(M[:, [1, 2], [1, 2]], axis=0).max()),
            "alone": [{"label": key, **one.alone, "together": len(one.relations)} for key, one in needs.items()],
        },
        lambda row, column: under,
        {
            "three_constraints": max(len(generic.relations), len(equal.relations)) <= 3,
            "still_more": min(generic.left, equal.left) > serial,
        },
        relations={
            f"Every off-diagonal inertia vanishes: {key.lower()}, {len(one.relations)} relations (a star marks a base "
            "parameter)": one.lines()
            for key, one in needs.items()
        },
    )


@dataclass(frozen=True, eq=False)
class Decoupling:
    """Linear relations of parameters under which the mass matrix is diagonal everywhere (section 5.3)."""

    basis: FundamentalBasis
    alone: Mapping[str, int]
    relations: Array

    @classmethod
    def of(cls, arm: Arm, basis: FundamentalBasis) -> Decoupling:
        """Relations that decouple an arm at 200 random positions."""
        weightless = Mechanism(replace(arm.mechanism.description, gravity=np.zeros(3)))
        p, _ = arm.states(np.random.default_rng(0), 200, 1.0)
        rest, unit = np.zeros_like(p), np.eye(arm.mechanism.dof)
        forces = [weightless.torque_regressor(p, rest, rest + unit[j], basis.columns) for j in range(len(unit))]
        rows = {f"M{i + 1}{j + 1}": forces[j][:, i] for i, j in combinations(range(len(unit)), 2)}
        alone = {term: int(np.linalg.matrix_rank(row, rtol=NEGLIGIBLE)) for term, row in rows.items()}
        _, values, right = np.linalg.svd(np.concatenate(list(rows.values())), full_matrices=False)
        needed = right[: np.count_nonzero(values > NEGLIGIBLE * values[0])]
        own = removable(needed.T, reversed(range(needed.shape[1])), NEGLIGIBLE)
        relations = np.linalg.solve(needed[:, own], needed)
        return cls(basis, alone, np.where(np.abs(relations) < NEGLIGIBLE, 0.0, relations))

    @property
    def left(self) -> int:
        """Number of independent parameters that are left when all relations hold."""
        return self.basis.rank - len(self.relations)

    def lines(self) -> tuple[str, ...]:
        """Relations as texts such as "link5.mc_x* = 0.6667 link4.mc_x*"; a star marks base parameters."""
        found, names = [], self.basis.names
        for row in self.relations:
            *others, own = np.flatnonzero(row)
            right = " ".join(f"{-row[j]:+.4g} {names[j]}*" for j in others)
            found.append(f"{names[own]}* = {right.removeprefix('+') or '0'}")
        return tuple(found)

    def of_parameters(self) -> Array:
        """Coefficients (m, P) of the relations, SI units."""
        return self.relations @ self.basis.regrouping


def left_under(arm: Arm, relations: int) -> int:
    """Rank of an `arm` under random independent `relations`."""
    random = np.random.default_rng(0).normal(size=(relations, arm.space.rank))
    free = arm.space.basis @ np.linalg.svd(random)[2][relations:].T
    states = arm.states(np.random.default_rng(1), 2 * arm.space.rank, 1.0)
    differences = np.diff(arm.mechanism.energy_regressor(*states), axis=0)
    return int(np.linalg.matrix_rank(differences @ free, rtol=NEGLIGIBLE))


def impossible_moments(mechanism: Mechanism, needs: Decoupling) -> tuple[float, float]:
    """Error (no unit) with which the generic relations add up to l5^2 I4 + l4^2 I5 = 0, and its value (kg m^4)."""
    rod, loops = _length(mechanism, 4), mechanism.description.loops
    forearm = float(loops.closures[0].second_frame.translation[0]) if loops else 0.0
    moments = np.zeros(len(mechanism.inertial_parameters))
    moments[[30, 39]] = forearm**2 * np.array([0.0, 1.0])
    moments[[40, 41, 49]] = rod**2 * np.array([forearm**2, -2.0 * forearm, 1.0])
    relations = needs.of_parameters()
    weights = np.linalg.lstsq(relations.T, moments)[0]
    return float(np.abs(relations.T @ weights - moments).max()), float(moments @ mechanism.inertial_parameters)


def decoupled(mechanism: Mechanism) -> Mechanism:
    """Decoupled parallelogram: no offsets from the plane, m5 (c5 - l3) = (l3/l2) m4 c4."""
    tens = mechanism.inertial_parameters.reshape(-1, 10).copy()
    upper, crank = _length(mechanism, 4), _length(mechanism, 3)
    places = tens[:, 1] / tens[:, 0]
    places[4] = crank + crank / upper * tens[3, 1] / tens[4, 0]
    for ten, place in zip(tens[1:], places[1:], strict=True):
        mass, center = ten[0], ten[1:4] / ten[0]
        tensor = inertia_tensor(ten) - mass * (center @ center * np.eye(3) - np.outer(center, center))
        ten[:] = from_center_of_mass(mass, np.array([place, 0.0, 0.0]), tensor)
    return mechanism.with_parameters(tens.ravel())


def _length(mechanism: Mechanism, link: int) -> float:
    """Distance (m) from the joint before a link's joint to it."""
    return float(mechanism.links[link].parent_to_joint.translation[0])


def conclusions(study: Study) -> Computation:
    """Section 6: what the paper concludes."""
    arm3, rank, graph = study.arm3.mechanism.description, study.arm3.space.rank, study.five_bar.space.rank
    two = Mechanism(replace(arm3, name=f"{arm3.name} to joint 2", links=arm3.links[:2]))
    weightless = Mechanism(replace(arm3, gravity=np.zeros(3)))
    least = dict(zip(("puma", "arm"), map(int, study.paper.claims["torque_34_20"].numbers.split()), strict=True))
    arms = {"puma": study.puma, "arm": study.nearly_parallel}
    found = {key: arm.fewest(least[key]) for key, arm in arms.items()}
    eight = int(study.paper.claims["eight"].numbers.split()[0])
    return Computation(
        {
            "rank": rank,
            "graph": graph,
            "two": essential_space(two).rank,
            "weightless": essential_space(weightless).rank,
            **{f"{key}_least": count for key, count in least.items()},
            **{f"{key}_share": percent(share) for key, (_, share) in found.items()},
            **{f"{key}_fewest": medians for key, (medians, _) in found.items()},
        },
        lambda row, column: rank if column == "three-joint PUMA" else graph,
        {"eight": rank == eight, "torque_34_20": all(share >= 0.5 for _, share in found.values())},
    )


STEPS = (table9, table10, figure6, table11, table12, table13, section53, conclusions)
"""In the order of the paper."""
