"""Page of an identification."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.identification.identification import Identification
from adaptctl.recording.drawing import MUTED, Drawing, run_color, sheet, thinned
from adaptctl.recording.page import SHEU_WALKER, Lines, Note, Report, Section, Table, TableLayout, files_section
from adaptctl.recording.result import Fact
from adaptctl.recording.wording import parameter_unit, torque_error_unit, typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Rows over which residuals are correlated; at most as many points of a curve
MAX_LAGS, MAX_DRAWN_POINTS = 60, 3000
SOURCE = (
    f"Method: {SHEU_WALKER}; T. Lee, P. M. Wensing and F. C. Park, Geometric Robot Dynamic Identification, IEEE "
    "Transactions on Robotics 36(2), 2020."
)


def verdict(found: Identification) -> str:
    """Outcome in a sentence: the root mean square error of the predicted torques."""
    validation = found.validation
    return (
        f"Predicts the torques of {validation.origin}, to {_rms_error(found)} over all joints, "
        f"{validation.relative_error:.1%} of what was measured."
    )


def _rms_error(found: Identification) -> str:
    return f"{found.validation.rms_error:.3g} {torque_error_unit(found.mechanism)}"


def consistency(found: Identification) -> str:
    """Sentences on whether rigid bodies can have the parameters, and on the cost of requiring it."""
    wrong = found.mechanism.description.inconsistent_links
    cost = f"The training rows are fitted {found.misfit_ratio - 1.0:.1%} worse than by least squares without that."
    if wrong:
        return f"No body can have the parameters of {', '.join(wrong)}. {cost}"
    return f"Every link is one that a rigid body can be, and the drives only take energy. {cost}"


def components(found: Identification) -> str:
    """Sentence on the number of essential components that give the energy to 1 %."""
    return (
        f"Of the {found.space.rank} essential components of the parameters, {found.components} carry the energy of the "
        "logs' motion to 1 % (Sheu and Walker 1991, equation 23)."
    )


def facts(found: Identification) -> Iterator[Fact]:
    """Questions that a reader asks first, and their answers in words."""
    validation, settings = found.validation, found.choice.settings
    yield Fact("error on data not seen", _rms_error(found))
    yield Fact("of the measured torque", f"{validation.relative_error:.1%}")
    yield Fact("fundamental parameters", str(len(found.names)))
    yield Fact("friction", settings.friction.words.replace("_", " "))
    yield Fact("physically consistent", "no" if found.mechanism.description.inconsistent_links else "yes")
    yield Fact("combinations left open", str(len(found.unexcited)))
    yield Fact("weight of the prior", f"{settings.weight:g}")
    yield Fact("cut-off", f"{settings.cutoff:g} Hz")


def report(found: Identification) -> Report:
    """Report of an identification."""
    return Report(
        experiment="identify",
        title=f"{found.mechanism.name}, identified",
        outcome=verdict(found),
        facts=tuple(facts(found)),
        sections=(
            _prediction(found),
            _parameters(found),
            _excited(found),
            _chosen(found),
            files_section(
                "The arm in the log's motion, and measured and predicted torques.",
                "The figures of this page, for programs.",
                {"validation.parquet": "Measured and predicted torques."},
            ),
        ),
        source=SOURCE,
    )


def _prediction(found: Identification) -> Section:
    validation, joints = found.validation, found.mechanism.primary_joints
    each = zip(joints, validation.joint_rms_errors, validation.joint_relative_errors, strict=True)
    rows = [(j.name, f"{rms:.3g} {typeset(j.kind.effort_unit)}", f"{x:.1%}") for j, rms, x in each]
    how = (
        f"On {validation.origin}, of which no fit has seen anything. Measured and predicted torques go through the "
        f"same zero-phase filter, below {validation.cutoff:g} Hz; instants in which the whole arm is at rest are left "
        "out."
    )
    torques = Drawing(
        "torques",
        f"Measured and predicted torque of every joint on {validation.origin}, below {validation.cutoff:g} Hz. "
        "Predictions use the measured motion alone.",
        partial(_torques, found),
    )
    residuals = Drawing(
        "residuals",
        "What the prediction leaves of the measured torques: over time, and how much of it is there again some rows "
        "later. White noise would leave nothing.",
        partial(_residuals, found),
    )
    unit = torque_error_unit(found.mechanism)
    estimates = {"this estimate": validation, **found.alternatives}.items()
    others = [(name, f"{other.rms_error:.3g} {unit}", f"{other.relative_error:.1%}") for name, other in estimates]
    heads = ("error, rms", "of its torque")
    return Section(
        "How well it predicts",
        (
            how,
            Table(("joint", *heads), rows, align="lrr"),
            torques,
            residuals,
            Table(("all joints, the same rows", *heads), others, align="lrr", marked=(0,)),
        ),
    )


def _parameters(found: Identification) -> Section:
    columns = zip(found.names, found.estimate, found.deviations, strict=True)
    rows = [(name, typeset(parameter_unit(name, found.mechanism)), f"{x:.4g}", f"{s:.2g}") for name, x, s in columns]
    head = (
        f"{consistency(found)} Deviations are by the block jackknife, with what the prior leaves open added; they are "
        f"{found.inflation:.1f} times those of white residuals at the median."
    )
    table = Table(("parameter", "unit", "estimate", "deviation"), rows, align="csrr", layout=TableLayout.HALVES)
    loads = ", ".join(f"{j.name} {x:.3f}" for j, x in zip(found.mechanism.primary_joints, found.load, strict=True) if x)
    grows = (
        "Friction grows with the load besides, by these shares of the rigid torque (robot.toml and robot.urdf do not "
        f"have this): {loads}."
    )
    basis = found.model.basis
    equations = Lines([str(equation) for equation in basis.equations()] if basis is not None else [])
    told = Note("Regrouping equations; a star marks the fundamental parameter.")
    return Section("Parameters", (head, table, *([grows] if loads else []), told, equations))


def _excited(found: Identification) -> Section:
    drawing = Drawing(
        "excitation",
        "How much the logs say of every combination of fundamental parameters: its prior range over the deviation "
        "that the logs leave, if residuals were white.",
        partial(_excitation, found),
    )
    left = (
        "These combinations the logs leave about as open as they were; the estimate has there what the robot's file "
        "says:",
        Lines([combination.words for combination in found.unexcited]),
    )
    return Section("What the logs excite", (components(found), *(left if found.unexcited else ()), drawing))


def _chosen(found: Identification) -> Section:
    trials = found.choice.trials
    steps = [*((step.name, step.outcome) for step in found.steps), *(("prior", remark) for remark in found.warnings)]
    rows = [(t.what, t.candidate, f"{t.rms:.4g}", "taken" if t.taken else "") for t in trials]
    taken = [k for k, trial in enumerate(trials) if trial.taken]
    choices = Table(("choice", "candidate", "error, rms", "taken"), rows, align="llr", marked=taken)
    told = "Chosen inside the training rows, by predicting blocks of time left out:"
    return Section("What was done and chosen", (Table(("step", "outcome"), steps), told, choices))


def _rows(found: Identification, columns: int, height: float) -> tuple[Figure, Any]:
    figure = sheet(height * found.mechanism.dof)
    axes: Any = figure.subplots(found.mechanism.dof, columns, sharex="col", squeeze=False)
    for joint, row in zip(found.mechanism.primary_joints, axes, strict=True):
        row[0].set_title(joint.name)
        row[0].set_ylabel(typeset(joint.kind.effort_unit))
    return figure, axes


def _torques(found: Identification) -> Figure:
    figure, axes = _rows(found, 1, 1.25)
    v = found.validation
    every = thinned(len(v.time), MAX_DRAWN_POINTS)
    for j, (ax,) in enumerate(axes):
        ax.plot(v.time[every], v.measured[every, j], ".", color=MUTED.hex, markersize=2.5, label="measured")
        ax.plot(v.time[every], v.predicted[every, j], color=run_color(0).hex, linewidth=1.2, label="predicted")
    axes[0][0].legend(loc="upper right", ncols=2)
    axes[-1][0].set_xlabel("time in the log, s")
    return figure


def _residuals(found: Identification) -> Figure:
    figure, axes = _rows(found, 2, 1.1)
    v, correlation = found.validation, found.validation.autocorrelation(MAX_LAGS)
    every = thinned(len(v.time), MAX_DRAWN_POINTS)
    for j, (over_time, over_lags) in enumerate(axes):
        over_time.plot(v.time[every], v.error[every, j], color=run_color(0).hex, linewidth=0.9)
        over_lags.bar(np.arange(len(correlation)), correlation[:, j], color=run_color(0).hex, width=0.8)
        over_lags.set_ylim(-0.5, 1.05)
    axes[-1][0].set_xlabel("time in the log, s")
    axes[-1][1].set_xlabel("rows later")
    return figure


def _excitation(found: Identification) -> Figure:
    figure = sheet(2.4)
    axes = figure.subplots()
    strengths = np.maximum([c.strength for c in found.combinations][::-1], 1e-6)
    axes.semilogy(np.arange(1, len(strengths) + 1), strengths, ".", color=run_color(0).hex)
    axes.set_xlabel("combination, by how well it is excited")
    return figure
