"""Page of an identification."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adaptctl.identification.hypotheses import TriedHypothesis
from adaptctl.identification.identification import Identification
from adaptctl.identification.validation import Validation
from adaptctl.identification.written import WrittenRobot
from adaptctl.recording.colors import MUTED, run_color
from adaptctl.recording.drawing import Drawing, sheet, thinned
from adaptctl.recording.page import (
    SHEU_WALKER,
    Cell,
    Lines,
    Note,
    Report,
    Section,
    Table,
    TableLayout,
    Tone,
    files_section,
)
from adaptctl.recording.result import Fact
from adaptctl.recording.wording import parameter_unit, typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Rows over which residuals are correlated; at most as many points of a curve
MAX_LAGS, MAX_DRAWN_POINTS = 60, 1500
SOURCE = (
    f"Method: {SHEU_WALKER}; T. Lee, P. M. Wensing and F. C. Park, Geometric Robot Dynamic Identification, IEEE "
    "Transactions on Robotics 36(2), 2020."
)


# Relative error of a joint's torque below which it is predicted well, and below which roughly; from 1 on, predicting no
# torque at all were better.
WELL, ROUGHLY = 0.2, 0.5


class JointVerdict(NamedTuple):
    """Verdict on a joint: its root mean square error with unit, relative to its own torque, in a word, and a tone."""

    name: str
    rms_error: float
    unit: str
    relative_error: float
    word: str
    tone: Tone

    @property
    def sentence(self) -> str:
        """Error and word, such as "0.31 N·m, 4.1 %: predicted"."""
        return f"{self.rms_error:.3g} {typeset(self.unit)}, {self.relative_error:.1%} of its torque: {self.word}"

    def as_builtins(self) -> dict[str, Any]:
        """Verdict in JSON's types."""
        relative = self.relative_error if np.isfinite(self.relative_error) else None
        return {"rms_error": self.rms_error, "unit": self.unit, "relative_error": relative, "verdict": self.word}


def joint_verdicts(found: Identification) -> list[JointVerdict]:
    """Verdicts on the joints, each relative to its own torque."""
    validation, left_out = found.validation, found.choice.settings.left_out
    each = zip(
        found.mechanism.primary_joints, validation.joint_rms_errors, validation.joint_relative_errors, strict=True
    )
    return [
        JointVerdict(j.name, float(rms), j.kind.effort_unit, float(x), *_word(float(x), k in left_out))
        for k, (j, rms, x) in enumerate(each)
    ]


def _word(relative: float, left_out: bool) -> tuple[str, Tone]:
    if left_out:
        return "left out", Tone.BAD
    if relative < WELL:
        return "predicted", Tone.GOOD
    if relative < ROUGHLY:
        return "roughly predicted", Tone.FAIR
    return ("poorly predicted", Tone.ODD) if relative < 1.0 else ("not predicted", Tone.BAD)


def verdict(found: Identification) -> str:
    """Outcome in a sentence: the root mean square error of the torques that the written robot predicts."""
    validation, band = found.validation, found.validation_in_band
    relative = _listed(f"{x:.1%}" for x in validation.relative_errors.values())
    said = (
        f"The identified robot predicts the torques of {validation.origin} with an RMS error of "
        f"{_rms_error(validation)} over all joints, {relative} of the measured torque"
    )
    if band is not validation:
        said += f" ({_rms_error(band)} below {band.cutoff:.3g} Hz, the band of the motion)"
    names = [joint.name for joint in joint_verdicts(found) if joint.word in ("not predicted", "left out")]
    return f"{said}; not predicted: {', '.join(names)}." if names else f"{said}."


def _rms_error(validation: Validation) -> str:
    return _listed(f"{rms:.3g} {typeset(unit)}" for unit, rms in validation.rms_errors.items())


def _listed(words: Iterable[str]) -> str:
    return " and ".join(words)


def consistency(found: Identification) -> str:
    """Sentences on whether rigid bodies can have the parameters, and on the cost of requiring it."""
    wrong = found.mechanism.description.inconsistent_links
    cost = (
        f"The error on the training rows is {found.misfit_ratio - 1.0:.1%} larger than with unconstrained least "
        "squares."
    )
    if wrong:
        return f"The parameters of {', '.join(wrong)} are not physically consistent. {cost}"
    return f"All links are physically consistent, and the drives are dissipative. {cost}"


def components(found: Identification) -> str:
    """Sentence on the number of essential components that give the energy to 1 %."""
    return (
        f"Without friction, the energy has {found.space.rank} essential components; {found.components} of them "
        "represent that of the logged motion to 1 % (Sheu and Walker 1991, equation 23)."
    )


def facts(found: Identification) -> Iterator[Fact]:
    """Questions that a reader asks first, and their answers in words."""
    validation, settings = found.validation, found.choice.settings
    yield Fact("RMS error on validation data", _rms_error(validation))
    yield Fact("relative to the measured torque", _listed(f"{x:.1%}" for x in validation.relative_errors.values()))
    yield Fact("base parameters", _counted(found))
    yield Fact("friction", settings.friction.words.replace("_", " "))
    yield Fact("physically consistent", "no" if found.mechanism.description.inconsistent_links else "yes")
    yield Fact("unexcited combinations", str(len(found.unexcited)))
    yield Fact("weight of the prior", f"{settings.weight:g}")
    yield Fact("cut-off", f"{settings.cutoff:.3g} Hz")


def _counted(found: Identification) -> str:
    """Number of base parameters, and of which and out of how many."""
    links = int(np.count_nonzero(np.array(found.model.columns) < found.mechanism.num_energy_parameters))
    friction = len(found.names) - links
    of = f": {links} of links and rotors, {friction} of friction" if friction else ""
    return f"{len(found.names)} of {len(found.mechanism.parameter_names)}{of}"


def best_hypotheses(found: Identification) -> list[TriedHypothesis]:
    """The log as it is, and the best hypothesis of each kind, the best first."""
    best = {trial.kind: trial for trial in sorted(found.hypotheses[1:], key=lambda t: -t.error)}
    return [*found.hypotheses[:1], *sorted(best.values(), key=lambda t: t.error)]


def log_lines(found: Identification) -> Iterator[tuple[str, str]]:
    """Lines on the logs: their rows and columns, their preparation, and what fits them best."""
    yield from found.steps
    if found.hypotheses:
        named = [trial for trial in found.hypotheses if trial.named]
        other = named[0].words if named else "no other meaning takes a third of it off"
        yield "meaning of the columns", f"the log as it is: {_off(found.hypotheses[0])} off; {other}"


def _off(trial: TriedHypothesis) -> str:
    return f"{'at least ' if trial.is_bound else ''}{trial.error:.2%}"


def _meaning(found: Identification) -> Section:
    trials = best_hypotheses(found)
    words = [t.words.replace("N m", typeset("N m")) for t in trials]
    named = [Cell("named", tone=Tone.BAD) if t.named else "" for t in trials]
    rows = [(t.kind, text, _off(t), cell) for t, text, cell in zip(trials, words, named, strict=True)]
    told = (
        "Each hypothesis about the columns is compared with the log as it is, by the error of the consistent estimate "
        "relative to the torques (geometric mean over the joints); here the best one of each kind. One that takes a "
        "third of the error off is named."
    )
    return Section("What the columns mean", (told, Table(("hypothesis", "in words", "error", ""), rows, align="llrl")))


def report(found: Identification, written: Sequence[WrittenRobot] = (), figures: bool = False) -> Report:
    """Report of an identification, with what its files predict, and beside it files of its figures or none."""
    return Report(
        experiment="identify",
        title=f"{found.mechanism.name}, identified",
        outcome=verdict(found),
        facts=tuple(facts(found)),
        sections=(
            *_noted(found, written),
            _prediction(found, written),
            _parameters(found),
            _excited(found),
            *([_meaning(found)] if found.hypotheses else []),
            _chosen(found),
            files_section(
                "The moving arm, with measured and predicted torques.",
                "The numbers of this report, as JSON.",
                {"validation.parquet": "Measured and predicted torques."},
                figures=figures,
            ),
        ),
        source=SOURCE,
    )


def _noted(found: Identification, written: Sequence[WrittenRobot]) -> Iterator[Section]:
    """Section of the warnings, and of what files cannot hold; none where there are no such."""
    notes = [*found.warnings, *(note for one in written if (note := one.note(found)) is not None)]
    if notes:
        yield Section("Notes", tuple(Note(note, warning=True) for note in notes))


def _prediction(found: Identification, written: Sequence[WrittenRobot]) -> Section:
    validation = found.validation
    rows = [
        (j.name, f"{j.rms_error:.3g} {typeset(j.unit)}", f"{j.relative_error:.1%}", Cell(j.word, tone=j.tone))
        for j in joint_verdicts(found)
    ]
    how = (
        f"On {validation.origin}, not used in any fit. Measured and predicted torques pass through the "
        f"same zero-phase filter, below {validation.cutoff:.3g} Hz, at all instants, standstill included. Predictions "
        f"are of the written robot, loaded again. A joint is predicted where its error is below {WELL:.0%} of its own "
        f"torque, and roughly below {ROUGHLY:.0%}; from 100 % on it is not, and predicting nothing would be as good."
    )
    torques = Drawing(
        "torques",
        f"Measured and predicted torques of all joints on {validation.origin}, below {validation.cutoff:.3g} Hz. "
        "Predictions use only the measured motion.",
        partial(_torques, found),
        plain=True,
    )
    residuals = Drawing(
        "residuals",
        "Residuals of the torque prediction: over time, and their autocorrelation over lags in rows. White noise has "
        "none.",
        partial(_residuals, found),
        plain=True,
    )
    estimates = {
        "this estimate, robot.toml": validation,
        **{one.name: one.validation for one in written[1:]},
        **found.alternatives,
    }
    others = [
        (name, _rms_error(other), _listed(f"{x:.1%}" for x in other.relative_errors.values()))
        for name, other in estimates.items()
    ]
    heads = ("RMS error", "relative to the torque")
    return Section(
        "Validation",
        (
            how,
            Table(("joint", *heads, "verdict"), rows, align="lrrl"),
            torques,
            residuals,
            Table(("all joints, the same rows", *heads), others, align="lrr", marked=(0,)),
        ),
    )


def _parameters(found: Identification) -> Section:
    columns = zip(found.names, found.estimate, found.deviations, strict=True)
    rows = [(name, typeset(parameter_unit(name, found.mechanism)), f"{x:.4g}", f"{s:.2g}") for name, x, s in columns]
    head = (
        f"{consistency(found)} Standard deviations are by the block jackknife, plus the uncertainty of the prior; they "
        f"are {found.deviation_ratio:.1f} times those for white residuals (median).{_without_interval(found)}"
    )
    table = Table(("parameter", "unit", "estimate", "deviation"), rows, align="csrr", layout=TableLayout.HALVES)
    basis = found.model.basis
    equations = Lines([str(equation) for equation in basis.equations()] if basis is not None else [])
    told = Note("Regrouping relations; a star marks a base parameter.")
    return Section("Parameters", (head, table, told, equations))


def _without_interval(found: Identification) -> str:
    none = [name for name, ends in zip(found.names, found.intervals, strict=True) if np.isnan(ends).any()]
    return f" {', '.join(none)}: no interval, the logs do not tell them." if none else ""


def _excited(found: Identification) -> Section:
    drawing = Drawing(
        "excitation",
        "Excitation of every combination of base parameters: its prior range over the standard deviation for white "
        "residuals.",
        partial(_excitation, found),
        plain=True,
    )
    left = (
        "The logs do not excite these combinations; the estimate has the values of the robot file:",
        Lines([combination.words for combination in found.unexcited]),
    )
    return Section("Excitation", (components(found), *(left if found.unexcited else ()), drawing))


def _chosen(found: Identification) -> Section:
    trials = found.choice.trials
    steps = [(step.name, step.outcome) for step in found.steps]
    rows = [(t.what, t.candidate, f"{t.relative_error:.2%}", "taken" if t.taken else "") for t in trials]
    taken = [k for k, trial in enumerate(trials) if trial.taken]
    choices = Table(("selection", "candidate", "error of blocks left out", "selected"), rows, align="llr", marked=taken)
    told = "Selected by block cross-validation on the training rows:"
    return Section("Preprocessing and model selection", (Table(("step", "outcome"), steps), told, choices))


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
    axes[-1][0].set_xlabel("time in the log [s]")
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure


def _residuals(found: Identification) -> Figure:
    figure, axes = _rows(found, 2, 1.1)
    v, correlation = found.validation, found.validation.autocorrelation(MAX_LAGS)
    every = thinned(len(v.time), MAX_DRAWN_POINTS)
    for j, (over_time, over_lags) in enumerate(axes):
        over_time.plot(v.time[every], v.error[every, j], color=run_color(0).hex, linewidth=0.9)
        places, colors = np.arange(len(correlation)), [run_color(0).hex] * len(correlation)
        over_lags.bar(places, correlation[:, j], bottom=0.0, color=colors, width=0.8)
        over_lags.set_ylim(-0.5, 1.05)
    axes[-1][0].set_xlabel("time in the log [s]")
    axes[-1][1].set_xlabel("lag [rows]")
    return figure


def _excitation(found: Identification) -> Figure:
    figure = sheet(2.4)
    axes = figure.subplots()
    strengths = np.maximum([c.strength for c in found.combinations][::-1], 1e-6)
    axes.semilogy(np.arange(1, len(strengths) + 1), strengths, ".", color=run_color(0).hex)
    axes.set_xlabel("combination, by excitation")
    return figure
