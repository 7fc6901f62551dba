"""Numbers behind the paper's tables of the semi-direct-drive arm and its comparisons, in its order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.description.inertia import pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication import drawings, proofs
from adaptctl.experiments.replication.arms import SampledArm, index, near_parallelogram, paper_rank, semi_direct_drive
from adaptctl.experiments.replication.cases import Study
from adaptctl.experiments.replication.judging import Computation, checked, inside, percent
from adaptctl.experiments.replication.puma560 import QUARTER, torque_figure
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.identifiability.factorisation import singular_values


def table9(study: Study) -> Computation:
    """Table 9: the semi-direct-drive arm's ranges against the built-in arm's."""
    arm, flat = study.five_bar.arm, np.zeros(200)
    p = np.stack([flat, flat, -np.linspace(arm.lower[2], arm.upper[2], 200)], axis=-1)
    closed, mechanism = arm.mechanism.continuation, arm.mechanism
    regular = closed.regularity(mechanism.configuration(p)).min() if closed else 1.0
    lower, upper = np.degrees([arm.lower[2], arm.upper[2]])
    return Computation({"regular": regular, "lower": lower, "upper": upper}, study.five_bar.limits)


def table10(study: Study) -> Computation:
    """Table 10: the semi-direct-drive arm's errors by the number of components, on one that was chosen to fit."""
    case, table = study.nearly_parallel, study.paper.tables["table10"]
    found, share, entry = *case.fewest(study.said("arm_torque")), case.errors
    lie, others = inside(checked(table, entry)), inside(checked(table, study.five_bar.errors))
    base = proofs.with_base_tilt(study.five_bar.arm.mechanism, proofs.QUARTERS[QUARTER])
    tilted = semi_direct_drive(study.paper, base)
    _, values, right = np.linalg.svd(study.differences(tilted))
    rank = int(paper_rank(np.asarray(values)))
    missing = right[:rank].T @ (right[:rank] @ tilted.parameters) - tilted.parameters
    left = tilted.sinusoid(study.frequency, study.motion_samples).Y[:, 0] @ missing
    return Computation(
        {
            "fewest": found,
            "outside": len(list(table.entries())) - lie,
            "other": others,
            "quarter": QUARTER,
            "rest": np.median(case.torque_errors[:, -1, 0]),
            "tilted_rank": rank,
            "tilted_error": float(np.mean(left**2)),
        },
        entry,
        {"arm_torque": share},
        relations=case.medians,
        drawings=[drawings.torque_errors("table-10", table, case.torque_errors)],
    )


def figure6(study: Study) -> Computation:
    """Figure 6: the torque of the semi-direct-drive arm's second joint with 10, 20 and 26 components."""
    return torque_figure(study.nearly_parallel, "figure-6", 2, (10, 20, 26))


def table11(study: Study) -> Computation:
    """Table 11: the order in which the other arm's parameters are removed, against the default one."""
    return Computation(entry=study.five_bar.places)


def table12(study: Study) -> Computation:
    """Table 12: the semi-direct-drive arm's set of independent parameters."""
    case, draws = study.five_bar, study.five_bar.draws
    space, basis = case.arm.space, case.basis
    near = {n: semi_direct_drive(study.paper, near_parallelogram(10.0**-n)) for n in (3, 5, 7, 9)}
    ranks = {f"rank{n}": paper_rank(singular_values(study.differences(arm))) for n, arm in near.items()}
    certified = {"certified": draws.rank, "kept": basis.rank, "gap": space.certificate.gap}
    return Computation(
        {**certified, **ranks, "parallelogram": study.parallelogram.space.rank},
        lambda row, link: index(row, link) in basis.columns,
        {
            "arm_independent": space.rank == basis.rank == study.said("arm_independent"),
            "arm_rank": study.rank_share("arm_rank", draws),
        },
        relations={"The independent parameters of the built-in arm": basis.equations()},
    )


def table13(study: Study) -> Computation:
    """Table 13: numbers of links, joints and parameters of both arms."""
    space, arm, columns = study.arm3.space, study.five_bar.arm, study.paper.tables["table13"].columns
    counts = dict(zip(columns, (_counts(study.arm3), _counts(arm)), strict=True))
    E = arm.energies(*arm.states(np.random.default_rng(study.seed), 4 * len(arm.parameters), 1.0))
    return Computation(
        {
            "rank": space.rank,
            "undifferenced": proofs.undifferenced(study.arm3.mechanism),
            "torque_rank": space.certificate.rank_torque or 0,
            "gap": space.certificate.gap,
            "whole": proofs.undifferenced(study.puma.arm.mechanism),
            "loop": proofs.scaled_rank(E, arm.space.scales).rank,
        },
        lambda row, column: counts[column][row],
    )


def section53(study: Study) -> Computation:
    """Section 5.3: relations that make the off-diagonal entries of the mass matrix vanish."""
    arms = {"generic": study.five_bar.arm, "parallelogram": study.parallelogram}
    bases = (study.five_bar.basis, fundamental_basis(study.parallelogram.space, study.five_bar.order))
    needs = {key: proofs.Decoupling.of(arms[key], basis) for key, basis in zip(arms, bases, strict=True)}
    generic, equal = needs.values()
    under, serial = proofs.left_under(study.five_bar.arm, 3), study.arm3.space.rank
    off, moments = proofs.impossible_moments(study.five_bar.arm.mechanism, generic)
    decoupled = proofs.decoupled(study.parallelogram.mechanism)
    M = decoupled.mass_matrix(study.parallelogram.states(np.random.default_rng(2), 100, 1.0)[0])
    forearm = decoupled.links[4].inertia
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
            "lowest": min(float(np.linalg.eigvalsh(pseudo_inertia(link.inertia))[0]) for link in decoupled.links),
            "off_diagonal": np.abs(M[:, [0, 0, 1], [1, 2, 2]]).max(),
            "vary": float(np.ptp(M[:, [1, 2], [1, 2]], axis=0).max()),
            "alone": [
                {"label": key.capitalize(), **one.per_term, "together": len(one.relations)}
                for key, one in needs.items()
            ],
        },
        lambda row, column: under,
        {
            "three_constraints": max(len(generic.relations), len(equal.relations)) <= 3,
            "still_more": min(generic.left, equal.left) > serial,
        },
        relations={
            f"Every off-diagonal inertia vanishes: {key}, {len(one.relations)} relations (a star: fundamental "
            "parameter)": one.lines()
            for key, one in needs.items()
        },
    )


def conclusions(study: Study) -> Computation:
    """Section 6: what the paper concludes."""
    arm3, rank, graph = study.arm3.mechanism.description, study.arm3.space.rank, study.five_bar.arm.space.rank
    two = Mechanism(replace(arm3, name=f"{arm3.name} to joint 2", links=arm3.links[:2]))
    weightless = Mechanism(replace(arm3, gravity=np.zeros(3)))
    least = dict(zip(("puma", "arm"), map(int, study.paper.claims["torque_34_20"].numbers.split()), strict=True))
    cases = {"puma": study.puma, "arm": study.nearly_parallel}
    found = {key: case.fewest(least[key]) for key, case in cases.items()}
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


def _counts(arm: SampledArm) -> dict[str, float]:
    mechanism, loops = arm.mechanism, arm.mechanism.description.loops
    return {
        "links": len(mechanism.links),
        "joints": len(mechanism.links) + (len(loops.closures) if loops else 0),
        "primary joints": mechanism.dof,
        "actuators": mechanism.dof,
        "dimension of essential space": arm.space.rank,
        "inertial parameters": len(mechanism.parameter_names),
    }


STEPS = (table9, table10, figure6, table11, table12, table13, section53, conclusions)
"""In the order of the paper."""
