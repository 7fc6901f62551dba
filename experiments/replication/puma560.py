"""Numbers behind the paper's tables and figures of the PUMA 560, in its order; `judging` compares, words.toml says."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.experiments.replication import drawings, proofs
from adaptctl.experiments.replication.arms import FASTEST, FROM, THRESHOLD, TO, Draws, index, kept, parameters, sign
from adaptctl.experiments.replication.cases import ENERGY, Entry, StudiedArm, Study
from adaptctl.experiments.replication.judging import Computation, Computed, RoundOff, checked, inside, percent
from adaptctl.experiments.replication.printed import Number, PrintedTable
from adaptctl.identifiability.energy_matrix import energy_differences
from adaptctl.identifiability.sampling import random_states

QUARTER = "3.14159/2"
"""The rounded right angle whose vector stands beside Table 8, and that tilts the base under Table 10."""
SLOPE, REAL = 0.5, np.array([3.0, 2.5])
"""c and D_R of the drawn example."""


def figure1(study: Study) -> Computation:
    """Figure 1: equations 27 to 30 by projection, in the drawn plane and in 1000 random ones."""
    essential, independent, forms = _plane(SLOPE, REAL)
    rng = np.random.default_rng(study.seed)
    worst = max(_plane(float(c), M)[2] for c, M in zip(rng.normal(size=1000), rng.normal(size=(1000, 2)), strict=True))
    drawing = drawings.two_parameters(SLOPE, REAL, essential, independent)
    return Computation({"forms": forms, "worst": worst}, agrees=max(forms, worst) < 1e-12, drawings=[drawing])


def table1(study: Study) -> Computation:
    """Table 1: the PUMA's ranges against the built-in arm's."""
    lower, upper, fastest = study.paper.tables["table1"].values(FROM, TO, FASTEST)
    rates = fastest / np.maximum(np.abs(lower), np.abs(upper))
    return Computation({"slowest": rates.min(), "fastest": rates.max()}, study.puma.limits)


def table2(study: Study) -> Computation:
    """Table 2: the PUMA's singular values against those of every draw."""
    draws, table, first = study.puma.draws, study.paper.tables["table2"], study.said("puma_first_34")
    k, values, weights = draws.rank, draws.singular_values, draws.weights
    literal = Draws.of(draws.arm, range(study.seed, study.seed + study.seeds), study.samples, 1.0).singular_values
    numbers = table.values().ravel()
    places = {entry[:2]: i for i, entry in enumerate(table.entries())}

    def entry(row: str, column: str) -> Computed:
        own = values[:, places[row, column]]
        return own if places[row, column] < k else RoundOff(float(np.median(own)), THRESHOLD * numbers[0])

    def scale(found: Array, start: int, stop: int) -> float:
        return float(np.exp(np.mean(np.log(np.median(found[:, start:stop], axis=0) / numbers[start:stop]))))

    falls = values[:, : k - 1] / values[:, 1:k]
    apart = (falls.argmax(axis=1) == first - 1) & (falls[:, first - 1] > 10.0)
    return Computation(
        {
            "certified": k,
            "first_scale": scale(values, 0, first),
            "last_scale": scale(values, first, k),
            "literal_scale": scale(literal, 0, first),
            "spread": np.median(values[:, 0] / values[:, first - 1]),
            "weight_spread": np.median(weights[:, 0] / weights[:, first - 1]),
        },
        entry,
        {"puma_rank": study.rank_share("puma_rank", draws), "puma_first_34": float(apart.mean())},
        drawings=[drawings.singular_values(draws, numbers[:k])],
    )


def figure3(study: Study) -> Computation:
    """Figure 3: energy errors of both arms over the number of components."""
    cases = (study.puma, study.five_bar, study.nearly_parallel)
    puma, generic, nearly = (case.draws.percent_errors for case in cases)
    limits = dict(zip((11, 17), map(float, study.paper.claims["arm_energy"].numbers.split()), strict=True))
    printed, arm = (_energies(study.paper.tables[name]) for name in ("table3", "table10"))
    arm |= {s: -limit for s, limit in limits.items()}
    table = study.paper.sentences["figure3"]
    checks = checked(table, lambda _, column: puma[:, int(column)])
    lies = [bool(inside([one])) for one in checks]
    below = [{s: errors[:, s] < limit for s, limit in limits.items()} for errors in (generic, nearly)]
    titles = ("PUMA 560", "semi-direct-drive, generic", f"… sides equal but for {percent(study.unequal)}")
    panels = {title: case.draws for title, case in zip(titles, cases, strict=True)}
    return Computation(
        {
            "above": sum(value > puma[:, s].max() for s, value in printed.items()),
            "largest_25": puma[:, 25].max(),
            "largest_30": puma[:, 30].max(),
            "lies_30": "yes" if lies[0] else "no",
            "lies_34": "yes" if lies[1] else "no",
            "medians": _medians(puma, 30, 34),
            "generic_medians": _medians(generic, 11, 17),
            "nearly_medians": _medians(nearly, 11, 17),
            "generic_shares": " and ".join(percent(float(np.mean(one))) for one in below[0].values()),
            "nearly_shares": " and ".join(percent(float(np.mean(one))) for one in below[1].values()),
        },
        lambda _, column: puma[:, int(column)],
        {
            "puma_energy": (all(lies), float(np.mean(puma[:, 30] >= float(checks[0].printed)))),
            "arm_energy": float(np.mean(below[0][11] & below[0][17])),
            "nearly_energy": float(np.mean(below[1][11] & below[1][17])),
        },
        drawings=[drawings.percent_errors(panels, dict(zip(titles, (printed, arm, arm), strict=True)))],
    )


def table3(study: Study) -> Computation:
    """Table 3: the PUMA's energy and torque errors by the number of components."""
    case, table = study.puma, study.paper.tables["table3"]
    found, share, entry = *case.fewest(study.said("puma_torque")), case.errors

    def ratio(*columns: str) -> float:
        own = [one for one in checked(table, entry) if one.column in columns and one.row != ENERGY]
        return float(np.exp(np.mean([np.log(float(one.computed) / Number.of(one.printed).value) for one in own])))

    return Computation(
        {"fewest": found, "ratio": ratio("10", "25", "30", "34"), "last_ratio": ratio("35")},
        entry,
        {"puma_torque": share},
        relations=case.medians,
        drawings=[drawings.torque_errors("table-3", table, case.torque_errors)],
    )


def figure4(study: Study) -> Computation:
    """Figure 4: the torque of the PUMA's first joint with 10, 25 and 36 components."""
    return torque_figure(study.puma, "figure-4", 1, (10, 25, 36))


def table4(study: Study) -> Computation:
    """Table 4: the order in which the PUMA's parameters are removed, against the default one."""
    return Computation(entry=study.puma.places)


def table5(study: Study) -> Computation:
    """Table 5: the PUMA's set of independent parameters, which has rank 33."""
    case, columns = study.puma, kept(study.paper.tables["table5"])
    space, mechanism = case.arm.space, case.arm.mechanism
    states = random_states(mechanism, 4 * len(space.parameter_names), np.random.default_rng(study.seed))
    found = proofs.scaled_rank(energy_differences(mechanism, states)[:, columns], space.scales[list(columns)])
    rounded = {text: proofs.rounded_set(mechanism, angle, case.order) for text, angle in proofs.QUARTERS.items()}
    return Computation(
        {
            "rank": found.rank,
            "gap": found.gap,
            "certified": space.rank,
            "kept": case.basis.rank,
            "torque": [
                {"text": text, "torque_share": proofs.torque_share(case.arm, text)} for text in proofs.NULL_COMBINATIONS
            ],
            "rounded": [
                {
                    "text": text,
                    "cells": 60 - len({*one.kept} ^ {*columns}),
                    "condition": one.condition,
                    "right": case.basis.condition,
                }
                for text, one in rounded.items()
            ],
        },
        lambda row, link: index(row, link) in case.basis.columns,
        {"puma_independent": space.rank == case.basis.rank == study.said("puma_independent")},
        relations={
            "Within Table 5, these change no torque (the paper's names)": proofs.NULL_COMBINATIONS,
            "The set that Table 4 yields with exact right angles": case.basis.equations(),
        },
    )


def table6(study: Study) -> Computation:
    """Table 6: the PUMA's assigned parameters, which are those of no rigid bodies."""
    D, null = study.puma.arm.parameters, study.puma.arm.space.null_basis
    lowest = [float(np.linalg.eigvalsh(pseudo_inertia(ten))[0]) for ten in D.reshape(-1, 10)]
    wrist = proofs.combination("I_x4 + I_y4 - I_z4 + I_x5 - I_y5 + I_z5")
    value, outside = float(wrist @ D), float(np.abs(null.T @ wrist).max())
    numbers = {f"link{i + 1}": least for i, least in enumerate(lowest)}
    numbers |= {"impossible": sum(least <= 0.0 for least in lowest), "wrist": value, "outside": outside}
    return Computation(numbers, _values(D), agrees=min(lowest) < 0.0 and value < 0.0 and outside < 1e-12)


def table7(study: Study) -> Computation:
    """Table 7: the PUMA's essential parameters V1 V1' D."""
    space, D, tables = study.puma.arm.space, study.puma.arm.parameters, study.paper.tables
    essential, real = space.project(D), parameters(tables["table6"])
    free = (real != 0.0) & (np.arange(len(D)) % 10 != 0)
    excess = [proofs.excess(space, tables["table6"], tables["table7"], where) for where in (np.zeros_like(free), free)]
    off = np.abs(essential - parameters(tables["table7"])).max()
    return Computation({"off": off, "as_printed": excess[0], "rounded": excess[1]}, _values(essential))


def table8(study: Study) -> Computation:
    """Table 8: values of the PUMA's independent parameters, with pi/2 rounded as the paper seems to have done."""
    case, vector = study.puma, parameters(study.paper.tables["table8"])
    D, space, basis, Y = case.arm.parameters, case.arm.space, case.basis, case.motion.Y
    essential, torque = parameters(study.paper.tables["table7"]), Y @ D
    rounded = proofs.rounded_set(case.arm.mechanism, proofs.QUARTERS[QUARTER], case.order).independent
    nonzero = [int(np.count_nonzero(np.abs(one) >= 0.0005)) for one in (vector, D, essential)]
    beta = zip(basis.names, basis.fundamental_parameters(D), strict=True)
    return Computation(
        {
            "quarter": QUARTER,
            **dict(zip(("nonzero", "real_nonzero", "essential_nonzero"), nonzero, strict=True)),
            "projected": np.abs(space.project(vector) - essential).max(),
            "torque": np.abs(Y @ vector - torque).max() / np.abs(torque).max(),
        },
        _values(rounded),
        {"fewer_nonzero": nonzero[0] < min(nonzero[1:])},
        relations={
            "Values on the right set (SI units, the tensor's own entries); the others of its 36 are zero": [
                f"{key} = {value:.4f}" for key, value in beta if abs(value) > 1e-9
            ]
        },
    )


def _energies(table: PrintedTable) -> dict[int, float]:
    """Printed energy errors by number of components; zero cannot be drawn."""
    return {int(s): value for s, value in zip(table.columns, table.values(ENERGY)[0], strict=True) if value > 0.0}


def _medians(percents: Array, *counts: int) -> str:
    return " and ".join(f"{np.median(percents[:, s]):.2g} %" for s in counts)


def _values(D: Array) -> Entry:
    """Parameters (P,) as the paper's tables have them."""
    return lambda row, link: float(sign(row) * D[index(row, link)])


def _plane(c: float, real: Array) -> tuple[Array, Array, float]:
    """D_E and D_I by projection and null vector, and by how much equations 29 and 30 differ from them."""
    e, n = np.array([1.0, c]) / np.hypot(1.0, c), np.array([-c, 1.0]) / np.hypot(1.0, c)
    essential = (real @ e) * e
    b = -essential[1] / n[1]
    independent = essential + b * n
    total = real[0] + c * real[1]
    forms = np.concatenate([total / (1.0 + c * c) * np.array([1.0, c]), [total, 0.0, -total * c / np.hypot(1.0, c)]])
    return essential, independent, float(np.abs(forms - [*essential, *independent, b]).max())


def torque_figure(case: StudiedArm, name: str, joint: int, counts: tuple[int, ...]) -> Computation:
    """Figure 4 or 6, called `name`: a joint's torque with fewer components, which fall in error to round-off."""
    motion, actual = case.motion, case.motion.Y @ case.arm.parameters
    torques = {"actual parameters": actual} | {f"{s} components": case.draws.torque(motion, 0, s) for s in counts}
    errors = {key: float(np.mean((tau - actual)[:, joint - 1] ** 2)) for key, tau in torques.items()}
    curves = {
        key if tau is actual else f"{key}, {errors[key]:.1e} (N·m)²": tau[:, joint - 1] for key, tau in torques.items()
    }
    falls = list(errors.values())[1:]
    return Computation(
        agrees=sorted(falls, reverse=True) == falls and falls[-1] < 1e-12,
        drawings=[drawings.torques(name, joint, motion, curves)],
    )


STEPS = (figure1, table1, table2, figure3, table3, figure4, table4, table5, table6, table7, table8)
"""In the order of the paper."""
