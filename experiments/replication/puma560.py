"""Computations of the PUMA 560's tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication import drawings
from adaptctl.experiments.replication.arms import ENERGY, THRESHOLD, Arm, Study, index, parameters, sign
from adaptctl.experiments.replication.judging import (
    BLANK,
    Computation,
    Computed,
    Entry,
    Number,
    Printed,
    RoundOff,
    checked,
    inside,
    percent,
)
from adaptctl.identifiability import EssentialSpace, Priority, essential_space
from adaptctl.identifiability.energy_matrix import NumericalRank, energy_differences
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.regrouping import removable
from adaptctl.identifiability.sampling import random_states
from adaptctl.recording.drawing import Drawing

ROUNDED_RANK_TOLERANCE = 1e-8
"""Tolerance at which rounded right angles leave rank."""
QUARTERS = {
    "3.1416/2": 3.1416 / 2,
    "3.14159/2": 3.14159 / 2,
    "3.141593/2": 3.141593 / 2,
    "single precision": float(np.float32(np.pi / 2)),
}
"""Right angles (rad), rounded."""
QUARTER = "3.14159/2"
"""Rounded right angle of Tables 8 and 10."""
TWIST_RIGHT_ANGLES = (-1, 0, 1, -1, 1, 0)
"""The PUMA's twists, in right angles."""
NULL_COMBINATIONS = ("I_y1 - I_x3 - I_z3", "I_x3 + I_y3 - I_x4 - I_z4", "I_x4 + I_y4 + I_y5 - I_z5 - I_x6 - I_y6")
"""Combinations of Table 5 that change no torque with exact right angles."""
SLOPE, REAL = 0.5, np.array([3.0, 2.5])
"""c and D_R of the example of Figure 1."""


def figure1(study: Study) -> Computation:
    """Figure 1: equations 27 to 30 by projection, in the drawn plane and in 1000 random ones."""
    rng = np.random.default_rng(study.seed)
    forms = _plane(SLOPE, REAL)
    worst = max(_plane(float(c), M) for c, M in zip(rng.normal(size=1000), rng.normal(size=(1000, 2)), strict=True))
    return Computation({"forms": forms, "worst": worst}, agrees=max(forms, worst) < 1e-12)


def _plane(c: float, real: Array) -> float:
    """Difference of equations 29 and 30 from D_E and D_I by projection and null vector, of m1 + c m2."""
    e, n = np.array([1.0, c]) / np.hypot(1.0, c), np.array([-c, 1.0]) / np.hypot(1.0, c)
    essential = (real @ e) * e
    b = -essential[1] / n[1]
    total = real[0] + c * real[1]
    forms = np.concatenate([total / (1.0 + c * c) * np.array([1.0, c]), [total, 0.0, -total * c / np.hypot(1.0, c)]])
    return float(np.abs(forms - [*essential, *(essential + b * n), b]).max())


def table1(study: Study) -> Computation:
    """Table 1: the PUMA's ranges against the built-in arm's."""
    lower, upper, fastest = study.puma.box
    rates = fastest / np.maximum(np.abs(lower), np.abs(upper))
    return Computation({"slowest": rates.min(), "fastest": rates.max()}, study.puma.limit)


def table2(study: Study) -> Computation:
    """Table 2: the PUMA's singular values against those of every draw."""
    arm, table, first = study.puma, study.paper.items["table2"], study.said("puma_first_34")
    k, values, weights = arm.space.rank, arm.singular_values, arm.weights
    literal = replace(arm, study=replace(study, velocity_scale=1.0)).singular_values
    numbers = table.values().ravel()
    places = {entry[:2]: i for i, entry in enumerate(table.entries())}

    def entry(row: str, column: str) -> Computed:
        own = values[:, places[row, column]]
        return own if places[row, column] < k else RoundOff(float(np.median(own)), THRESHOLD * numbers[0])

    def scale(found: Array, start: int, stop: int) -> float:
        return float(np.exp(np.mean(np.log(np.median(found[:, start:stop], axis=0) / numbers[start:stop]))))

    falls = values[:, : k - 1] / values[:, 1:k]
    apart = (falls.argmax(axis=1) == first - 1) & (falls[:, first - 1] > 10.0)
    caption = f"Table 2: the {k} singular values that are not round-off"
    panels = {"PUMA 560": (values[:, :k], dict(enumerate(numbers[:k].tolist(), 1)))}
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
        {"puma_rank": arm.rank_share("puma_rank"), "puma_first_34": float(apart.mean())},
        drawings=[drawings.bands("table-2", caption, "singular value", panels, first=1)],
    )


def figure3(study: Study) -> Computation:
    """Figure 3: energy errors of both arms against the number of components."""
    arms = (study.puma, study.five_bar, study.nearly_parallel)
    puma, *pair = (arm.percent_errors for arm in arms)
    others = dict(zip(("generic", "nearly"), pair, strict=True))
    limits = dict(zip((11, 17), map(float, study.paper.claims["arm_energy"].numbers.split()), strict=True))
    printed, arm = (_energies(study.paper.items[name]) for name in ("table3", "table10"))
    checks = checked(study.paper.items["figure3"], lambda _, column: puma[:, int(column)])
    lies = [bool(inside([one])) for one in checks]
    below = {name: [errors[:, s] < x for s, x in limits.items()] for name, errors in others.items()}
    titles = ("PUMA 560", "semi-direct-drive, generic", f"… with sides equal up to {percent(study.unequal)}")
    points = (printed, *2 * [{**arm, **{s: -limit for s, limit in limits.items()}}])
    panels = {title: (x.percent_errors[:, :-1], own) for title, x, own in zip(titles, arms, points, strict=True)}
    caption = "Figure 3: error of the energy, at the states fitted, over the number of components kept"
    return Computation(
        {
            "above": sum(value > puma[:, s].max() for s, value in printed.items()),
            "largest_25": puma[:, 25].max(),
            "largest_30": puma[:, 30].max(),
            **{f"lies_{s}": "yes" if one else "no" for s, one in zip((30, 34), lies, strict=True)},
            "medians": _medians(puma, 30, 34),
            **{f"{name}_medians": _medians(errors, 11, 17) for name, errors in others.items()},
            **{f"{name}_shares": " and ".join(percent(float(np.mean(x))) for x in one) for name, one in below.items()},
        },
        lambda _, column: puma[:, int(column)],
        {
            "puma_energy": (all(lies), float(np.mean(puma[:, 30] >= float(checks[0].printed)))),
            "arm_energy": float(np.mean(np.all(below["generic"], axis=0))),
            "nearly_energy": float(np.mean(np.all(below["nearly"], axis=0))),
        },
        drawings=[drawings.bands("figure-3", caption, "energy error [%]", panels)],
    )


def _energies(table: Printed) -> Mapping[int, float]:
    """Printed energy errors by number of components; zero cannot be drawn."""
    return {int(s): value for s, value in zip(table.columns, table.values(ENERGY)[0], strict=True) if value > 0.0}


def _medians(percents: Array, *counts: int) -> str:
    return " and ".join(f"{np.median(percents[:, s]):.2g} %" for s in counts)


def table3(study: Study) -> Computation:
    """Table 3: the PUMA's energy and torque errors by the number of components."""
    arm, table = study.puma, study.paper.items["table3"]
    fewest, share = arm.fewest(study.said("puma_torque"))

    def ratio(*columns: str) -> float:
        own = [one for one in checked(table, arm.error) if one.column in columns and one.row != ENERGY]
        return float(np.exp(np.mean([np.log(float(one.computed) / Number.of(one.printed).value) for one in own])))

    return Computation(
        {"fewest": fewest, "ratio": ratio("10", "25", "30", "34"), "last_ratio": ratio("35")},
        arm.error,
        {"puma_torque": share},
        drawings=[drawn_torque_errors("table-3", arm, table)],
    )


def drawn_torque_errors(name: str, arm: Arm, table: Printed) -> Drawing:
    """Drawing of Table 3 or 10, called `name` ("table-3"), from the draws of an `arm` and the printed `table`."""
    k, caption = arm.space.rank, f"{name.replace('-', ' ').title()}: mean square torque errors, one panel per joint"
    panels = {
        f"joint {j}": (
            arm.torque_errors[:, :k, j - 1],
            {int(s): x for s, x in zip(table.columns, table.values(f"joint{j}")[0], strict=True) if int(s) < k},
        )
        for j in range(1, arm.mechanism.dof + 1)
    }
    return drawings.bands(name, caption, "mean square torque error [(N·m)²]", panels)


def figure4(study: Study) -> Computation:
    """Figure 4: the torque of the PUMA's first joint with 10, 25 and 36 components."""
    return torque_figure(study.puma, "figure-4", 1, (10, 25, 36))


def torque_figure(arm: Arm, name: str, joint: int, counts: tuple[int, ...]) -> Computation:
    """Figure 4 or 6: a joint's torque with fewer components."""
    Y = arm.motion.Y[:, joint - 1]
    actual = Y @ arm.parameters
    torques = {s: Y @ arm.reductions[0].parameters(s) for s in counts}
    falls = {s: float(np.mean((torque - actual) ** 2)) for s, torque in torques.items()}
    curves = {f"{s} components, {falls[s]:.1e} (N·m)²": torque for s, torque in torques.items()}
    return Computation(
        agrees=sorted(falls.values(), reverse=True) == [*falls.values()] and falls[counts[-1]] < 1e-12,
        drawings=[drawings.torques(name, arm, joint, {"actual parameters": actual} | curves)],
    )


def table4(study: Study) -> Computation:
    """Table 4: the order in which the PUMA's parameters are removed, against the default one."""
    return Computation(entry=study.puma.places)


def table5(study: Study) -> Computation:
    """Table 5: the PUMA's set of independent parameters, which has rank 33."""
    arm, space, mechanism = study.puma, study.puma.space, study.puma.mechanism
    columns = {index(row, link) for row, link, text in study.paper.items["table5"].entries() if text != BLANK}
    states = random_states(mechanism, 4 * len(space.parameter_names), np.random.default_rng(study.seed))
    own = sorted(columns)
    found = NumericalRank.from_singular_values(
        singular_values(energy_differences(mechanism, states)[:, own] * space.scales[own])
    )
    rounded = {text: rounded_set(mechanism, angle, arm.order) for text, angle in QUARTERS.items()}
    return Computation(
        {
            "rank": found.rank,
            "gap": found.gap,
            "certified": space.rank,
            "kept": arm.basis.rank,
            "torque": [{"text": text, "torque_share": torque_share(arm, text)} for text in NULL_COMBINATIONS],
            "rounded": [
                {"text": text, "cells": 60 - len({*kept} ^ columns), "condition": worst, "right": arm.basis.condition}
                for text, (kept, worst, _) in rounded.items()
            ],
        },
        lambda row, link: index(row, link) in arm.basis.columns,
        {"puma_independent": space.rank == arm.basis.rank == study.said("puma_independent")},
    )


def rounded_set(mechanism: Mechanism, quarter: float, priority: Priority) -> tuple[tuple[int, ...], float, Array]:
    """Set of theorem 4.1 with a rounded pi/2 in all twists."""
    links = tuple(
        replace(link, joint_to_link=Pose(rotation_about((1, 0, 0), n * quarter), link.joint_to_link.translation))
        for link, n in zip(mechanism.links, TWIST_RIGHT_ANGLES, strict=True)
    )
    space = essential_space(Mechanism(replace(mechanism.description, links=links)))
    essential = space.project(mechanism.inertial_parameters)
    removed = list(removable(space.null_basis, priority.indices(space.parameter_names), ROUNDED_RANK_TOLERANCE))
    square = space.null_basis[removed]
    independent = essential - space.null_basis @ np.linalg.solve(square, essential[removed])
    return tuple(sorted(set(range(len(essential))) - set(removed))), float(np.linalg.cond(square)), independent


def combination(text: str, links: int = 6) -> Array:
    """Coefficients (10 N,) of a text such as "I_y1 - I_x3 - I_z3"."""
    out, texts = np.zeros(10 * links), ("+ " + text).split()
    for mark, term in zip(texts[::2], texts[1::2], strict=True):
        out[index(term[:-1], term[-1])] = sign(term[:-1]) * (1.0 if mark == "+" else -1.0)
    return out


def torque_share(arm: Arm, text: str) -> float:
    """Largest torque of a combination divided by the largest torque of its terms."""
    vector = combination(text)
    p, v, a = np.random.default_rng(0).normal(size=(3, 500, arm.mechanism.dof))
    Y = arm.mechanism.torque_regressor(p, v, a)
    return float(np.abs(Y @ vector).max() / np.abs(Y[..., vector != 0.0]).max())


def table6(study: Study) -> Computation:
    """Table 6: the PUMA's assigned parameters, which are those of no rigid bodies."""
    D, null = study.puma.parameters, study.puma.space.null_basis
    lowest = [float(np.linalg.eigvalsh(pseudo_inertia(ten))[0]) for ten in D.reshape(-1, 10)]
    wrist = combination("I_x4 + I_y4 - I_z4 + I_x5 - I_y5 + I_z5")
    value, outside = float(wrist @ D), float(np.abs(null.T @ wrist).max())
    numbers = {f"link{i + 1}": least for i, least in enumerate(lowest)}
    numbers |= {"impossible": sum(least <= 0.0 for least in lowest), "wrist": value, "outside": outside}
    return Computation(numbers, _values(D), agrees=min(lowest) < 0.0 and value < 0.0 and outside < 1e-12)


def table7(study: Study) -> Computation:
    """Table 7: the PUMA's essential parameters V1 V1' D."""
    space, tables = study.puma.space, study.paper.items
    essential, real = space.project(study.puma.parameters), parameters(tables["table6"])
    free = (real != 0.0) & (np.arange(len(real)) % 10 != 0)
    numbers = {
        "off": np.abs(essential - parameters(tables["table7"])).max(),
        "as_printed": excess(space, tables["table6"], tables["table7"], np.zeros_like(free)),
        "rounded": excess(space, tables["table6"], tables["table7"], free),
    }
    return Computation(numbers, _values(essential))


def excess(space: EssentialSpace, real: Printed, essential: Printed, free: Array) -> float:
    """Smallest ratio of differences to rounding errors, by a linear program: at most 1 if rounding explains all."""
    tolerance = parameters(essential, half_units=True)
    slack = np.where(free, parameters(real, half_units=True), 0.0)
    project = space.basis @ space.basis.T / tolerance[:, None]
    off = project @ parameters(real) - parameters(essential) / tolerance
    found = linprog(
        np.append(np.zeros(len(slack)), 1.0),
        A_ub=np.column_stack([np.concatenate([project, -project]), -np.ones(2 * len(slack))]),
        b_ub=np.concatenate([-off, off]),
        bounds=[*((-x, x) for x in slack), (0.0, None)],
    )
    if found.fun is None:
        raise ArithmeticError(f"the linear program was not solved: {found.message}")
    return float(found.fun)


def table8(study: Study) -> Computation:
    """Table 8: values of the PUMA's independent parameters, with a rounded pi/2."""
    arm, vector = study.puma, parameters(study.paper.items["table8"])
    D, Y, essential = arm.parameters, arm.motion.Y, parameters(study.paper.items["table7"])
    torque = Y @ D
    _, _, rounded = rounded_set(arm.mechanism, QUARTERS[QUARTER], arm.order)
    nonzero = [int(np.count_nonzero(np.abs(one) >= 0.0005)) for one in (vector, D, essential)]
    return Computation(
        {
            "quarter": QUARTER,
            **dict(zip(("nonzero", "real_nonzero", "essential_nonzero"), nonzero, strict=True)),
            "projected": np.abs(arm.space.project(vector) - essential).max(),
            "torque": np.abs(Y @ vector - torque).max() / np.abs(torque).max(),
        },
        _values(rounded),
        {"fewer_nonzero": nonzero[0] < min(nonzero[1:])},
    )


def _values(D: Array) -> Entry:
    return lambda row, link: float(sign(row) * D[index(row, link)])


STEPS = (figure1, table1, table2, figure3, table3, figure4, table4, table5, table6, table7, table8)
"""In the order of the paper."""
