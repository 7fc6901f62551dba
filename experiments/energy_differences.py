"""Energy differences as an estimator on a real log: exact in theory, and what they make of torques that are off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.experiments.experiment import Experiment, Progress, setting
from adaptctl.files import write_json, write_text
from adaptctl.identification.energy_differences import by_energy
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.recording.drawing import WIDTH, Drawing, write_drawings
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.palette import run_color

STAGE = "Estimators"
FRICTION = "viscous,coulomb,square_root"
HELD_OUT = 0.4
WEIGHT, CUTOFF = 5.0, 25.0


class Measured(NamedTuple):
    """What both estimators make of one kind of torques: errors on the log's end, over the torques there."""

    torques: str
    off: float
    """how far the torques are off, relative"""
    momentum: float
    energy: float


@dataclass(frozen=True)
class EnergyDifferences(Experiment):
    """Energy differences beside filtered dynamics, on torques that are exact, noisy, and measured."""

    name: ClassVar[str] = "energy-differences"
    title: ClassVar[str] = "{robot}: parameters from energy differences"

    robot: str = setting("tx40", "an example that comes with a real log")
    window: float = setting(0.1, "length of an energy difference, s", low=0.01, high=2.0)

    def compare(self, progress: Progress) -> Amplification:
        """Fit the log's first part, predict its last, with the measured torques and with made ones."""
        progress(STAGE, 0.0)
        evidence, log = _evidence(self.robot)
        model = _model(evidence)
        truth = _torques(evidence, model)
        rng = np.random.default_rng(self.seed)
        size = np.sqrt(np.mean(truth**2, axis=0))
        noise, residual = rng.normal(size=truth.shape) * size, log.torque - truth
        cases = [("exact, of the fitted model", 0.0 * noise)]
        cases += [(f"with {share:.0%} of white noise", share * noise) for share in (0.01, 0.05)]
        cases += [("with a tenth of the log's residual", 0.1 * residual), ("measured", residual)]
        found = []
        for i, (words, off) in enumerate(cases):
            momentum, energy = self._fitted(_with_torques(evidence, truth + off))
            errors = (_error(evidence, x, model) for x in (momentum, energy))
            found.append(Measured(words, float(np.linalg.norm(off) / np.linalg.norm(truth)), *errors))
            progress(STAGE, (i + 1) / len(cases))
        title = self.title.format(robot=evidence.mechanism.name)
        return Amplification(self.name, title, self.window, tuple(found), _curves(evidence, momentum, energy))

    def _fitted(self, evidence: LogEvidence) -> tuple[Array, Array]:
        """Parameters (P,) by filtered dynamics and by energy differences, of the log's first part."""
        friction = FrictionModel.named(FRICTION)
        P = len(evidence.mechanism.parameter_names)
        columns = evidence.independent(friction)
        x, _ = weighted_least_squares(evidence.equations(CUTOFF, _early(evidence)), columns)
        end = evidence.edges[len(_early(evidence))][1]
        motions = [_until(motion, end) for motion in evidence.motions]
        own = np.array([c for c in columns.tolist() if c < P])
        return x[:P], by_energy(motions, evidence.mechanism, self.window, own)


def _evidence(name: str) -> tuple[LogEvidence, Any]:
    """Of an example's log, and the log."""
    from adaptctl.identification.drives_file import read_drives
    from adaptctl.identification.examples import example
    from adaptctl.identification.identify import gathered
    from adaptctl.identification.joint_log import joint_log
    from adaptctl.identification.reading.registry import read_log

    with example(name) as files:
        mechanism = load(files.robot, snap=True)
        drives = read_drives(files.drives).of(mechanism)
        log = joint_log(read_log(files.log), drives, mechanism)
    return gathered(mechanism, drives, [log])[0], log


def _early(evidence: LogEvidence) -> range:
    return range(round((1.0 - HELD_OUT) * evidence.blocks))


def _until(motion: SmoothMotion, end: float) -> SmoothMotion:
    """A motion's first part, up to a time of the log."""
    times = motion.log.time[motion.first :: motion.every][: len(motion.position)]
    count = int(np.sum(times < end))
    return replace(motion, position=motion.position[:count], velocity=motion.velocity[:count])


def _torques(evidence: LogEvidence, x: Array) -> Array:
    """The model's torques at every sample of the log, by straight lines between those of the motion."""
    (motion,) = evidence.motions
    inner = slice(2, -2)
    p, v, a = motion.position[inner], motion.velocity[inner], motion.acceleration()
    torque = evidence.mechanism.with_parameters(x).inverse_dynamics(p, v, a)
    times = motion.log.time[motion.first :: motion.every][: len(motion.position)][inner]
    return np.stack([np.interp(motion.log.time, times, column) for column in torque.T], axis=-1)


def _model(evidence: LogEvidence) -> Array:
    """Consistent parameters (P,) of the whole log, which stand for the truth."""
    settings = FitSettings(FrictionModel.named(FRICTION), WEIGHT, CUTOFF)
    return evidence.fit(settings, range(evidence.blocks)).x[: len(evidence.mechanism.parameter_names)]


def _with_torques(evidence: LogEvidence, torque: Array) -> LogEvidence:
    """The same motion with other torques."""
    from adaptctl.identification.filtered_dynamics import rows_of

    motions = [replace(motion, log=replace(motion.log, torque=torque)) for motion in evidence.motions]
    rows = dict(zip(evidence.rows, rows_of(motions, evidence.mechanism, list(evidence.rows)), strict=True))
    return replace(evidence, motions=motions, rows=rows)


def _error(evidence: LogEvidence, x: Array, truth: Array) -> float:
    """Of torques on the log's last part, over the true model's."""
    rows = evidence.rows[CUTOFF]
    late: NDArray[np.bool_] = rows.time >= evidence.edges[len(_early(evidence))][1]
    expected = rows.regressor[late] @ truth
    return float(np.linalg.norm(rows.regressor[late] @ x - expected) / np.linalg.norm(expected))


class Curves(NamedTuple):
    """Torques (n, r) on the log's last part: measured, and predicted by both estimators from measured torques."""

    joints: tuple[str, ...]
    time: Array
    measured: Array
    momentum: Array
    energy: Array


def _curves(evidence: LogEvidence, momentum: Array, energy: Array) -> Curves:
    rows = evidence.rows[CUTOFF]
    late = rows.time >= evidence.edges[len(_early(evidence))][1]
    Y = rows.regressor[late]
    joints = tuple(joint.name for joint in evidence.mechanism.primary_joints)
    return Curves(joints, rows.time[late], rows.torque[late], Y @ momentum, Y @ energy)


@dataclass(frozen=True, eq=False)
class Amplification:
    """How far torques that are off throw either estimator off."""

    experiment: str
    title: str
    window: float
    measured: tuple[Measured, ...]
    curves: Curves
    complete: bool = True

    def headline(self) -> str:
        """The finding."""
        last, exact = self.measured[-1], self.measured[0]
        return (
            f"From exact torques, energy differences predict to {exact.energy:.2%}; from measured ones to "
            f"{last.energy:.0%}, where filtered dynamics is {last.momentum:.1%} off: one scalar equation a window "
            f"amplifies what torques are off by {last.energy / last.momentum:.0f} times as much."
        )

    def facts(self) -> Iterator[tuple[str, str]]:
        """Each kind of torques."""
        for entry in self.measured:
            yield entry.torques, f"filtered dynamics {entry.momentum:.2%}, energy differences {entry.energy:.2%}"

    def write(self, folder: Path, progress: Callable[[str, float], object]) -> None:
        """Summary, figure, report and recording."""
        progress("summary", 0.0)
        content = {
            "schema": "adaptctl/energy-differences/1",
            "experiment": self.experiment,
            "window": self.window,
            "torques": [entry._asdict() for entry in self.measured],
        }
        (folder / "figures").mkdir(exist_ok=True)
        figures = write_drawings(folder / "figures", self._drawings())
        page = rendered(
            "findings.html",
            "adaptctl.recording.identified",
            title=self.title,
            lead=self.headline(),
            facts=list(self.facts()),
            rows=[(e.torques, f"{e.off:.2%}", f"{e.momentum:.2%}", f"{e.energy:.2%}") for e in self.measured],
            figures=embedded(self._drawings(), figures),
        )
        write_text(folder / "report.html", page)
        write_json(folder / "summary.json", content)
        self._record(folder / "recording.rrd")
        progress("report", 1.0)

    def _record(self, path: Path) -> None:
        """Torques over time, a joint a view."""
        import rerun.blueprint as rrb

        from adaptctl.recording.scene import entity
        from adaptctl.recording.series import Style, log_series
        from adaptctl.recording.stream import log_markdown, saved_stream

        curves = self.curves
        views = [rrb.TimeSeriesView(origin=entity(name), name=f"{name}: torque") for name in curves.joints]
        text = rrb.TextDocumentView(origin="summary", name="summary")
        layout = rrb.Blueprint(rrb.Vertical(text, *views), collapse_panels=True)
        with saved_stream(path, self.experiment, f"{self.experiment}-{self.window:g}", layout) as recording:
            log_markdown(recording, "summary", self.headline())
            for j, name in enumerate(curves.joints):
                values = np.stack([curves.measured[:, j], curves.momentum[:, j], curves.energy[:, j]], axis=-1)
                labels = ("measured", "filtered dynamics", "energy differences")
                style = Style(labels, [run_color(i) for i in range(3)])
                log_series(recording, entity(name), curves.time, values, style)

    def _drawings(self) -> Iterator[Drawing]:
        yield Drawing(
            "amplification", "Error of predicted torques on the log's last part, of both estimators.", self._draw
        )

    def _draw(self) -> Figure:
        figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
        ax: Any = figure.subplots()
        place = np.arange(len(self.measured))
        for i, (label, values) in enumerate(
            (
                ("filtered dynamics", [e.momentum for e in self.measured]),
                ("energy differences", [e.energy for e in self.measured]),
            )
        ):
            ax.barh(place + 0.38 * i, np.maximum(values, 1e-5), 0.36, color=run_color(i).hex, label=label)
        ax.set_yticks(place + 0.19, [e.torques for e in self.measured])
        ax.set_xscale("log")
        ax.invert_yaxis()
        ax.set_xlabel("error over the torques")
        ax.legend(loc="lower right")
        return figure
