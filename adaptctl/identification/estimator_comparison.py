"""Comparison of two estimators on a real log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identification.columns import joint_log
from adaptctl.identification.drives_file import read_drives
from adaptctl.identification.energy_differences import by_energy
from adaptctl.identification.filtered_dynamics import SmoothMotion, rows_of
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.identification.log_files import read_log
from adaptctl.identification.momentum_balance import MomentumBalance
from adaptctl.identification.preparation import DIFFERENCE_MARGIN
from adaptctl.recording.page import SHEU_WALKER, Report, Section, Table
from adaptctl.recording.result import Fact, Progress, silent
from adaptctl.stages import stage

TEXT = (
    "Both estimators are fitted to the first part of one motion and predict its last part. The torques are those of a "
    "fitted model with increasing errors, up to the measured torques."
)
FRICTION = "viscous,coulomb,square_root"
HELD_OUT_SHARE = 0.4
# Weight of the robot file's links and cut-off in Hz that the log's identification chooses.
PRIOR_WEIGHT, CUTOFF = 5.0, 25.0
SETTINGS = FitSettings(FrictionModel.named(FRICTION), PRIOR_WEIGHT, CUTOFF)


class TorqueCase(NamedTuple):
    """Relative errors of two estimators for one kind of torques that they are fitted to."""

    torques: str
    off: float
    momentum: float
    energy: float


@dataclass(frozen=True)
class Amplification:
    """Comparison of two estimators by how much they amplify the errors of measured torques."""

    robot: str
    window: float
    measured: tuple[TorqueCase, ...]
    seed: int

    def report(self) -> Report:
        """Report of both estimators' errors."""
        last, exact = self.measured[-1], self.measured[0]
        found = (
            f"With exact torques, the prediction error of energy differences is {exact.energy:.2%}; with measured "
            f"torques {last.energy:.0%}, against {last.momentum:.1%} of filtered dynamics: one scalar equation per "
            f"window amplifies torque errors by a factor of {last.energy / last.momentum:.0f} more."
        )
        rows = [(e.torques, f"{e.off:.2%}", f"{e.momentum:.2%}", f"{e.energy:.2%}") for e in self.measured]
        table = Table(("torques", "torque error", "filtered dynamics", "energy differences"), rows, align="lrrr")
        return Report(
            "energy-differences",
            f"{self.robot}: parameters from energy differences",
            found,
            [Fact(e[0], f"filtered dynamics {e[2]}, energy differences {e[3]}") for e in rows],
            [Section("Effect of torque errors on both estimates", (TEXT, table))],
            seed=self.seed,
            source=f"Method: {SHEU_WALKER}.",
        )

    def write(self, folder: Path, progress: Progress = silent) -> None:
        """Write summary, report and recording into a folder, all or none."""
        content = {
            "schema": "adaptctl/energy-differences/1",
            "experiment": "energy-differences",
            "window": self.window,
            "torques": [entry._asdict() for entry in self.measured],
        }
        self.report().write(folder, content, progress=progress)


def validate_window(window: float) -> None:
    """Raise `InputError` for windows that energies are not compared over."""
    if not 0.01 <= window <= 2.0:
        raise InputError(f"energy differences: expected windows of 0.01 to 2 s, got {window:g}")


@stage("comparing estimators")
def compared_estimators(
    log: str | Path, robot: str | Path | Mechanism, drives: str | Path, window: float = 0.1, seed: int = 0
) -> Amplification:
    """Errors of two estimators on a log, with a model of the whole log taken as the truth."""
    validate_window(window)
    mechanism = robot if isinstance(robot, Mechanism) else load(robot)
    own = read_drives(drives).ordered_like(mechanism)
    read = joint_log(read_log(log), own)
    evidence = gathered(mechanism, own, [read], cutoff=CUTOFF)[0]
    model = _model(evidence)
    truth = _torques(evidence, model)
    size = np.sqrt(np.mean(truth**2, axis=0))
    noise, residual = np.random.default_rng(seed).normal(size=truth.shape) * size, read.torque - truth
    cases = [("exact, of the fitted model", 0.0 * noise)]
    cases += [(f"with {share:.0%} of white noise", share * noise) for share in (0.01, 0.05)]
    cases += [("with a tenth of the log's residual", 0.1 * residual), ("measured", residual)]
    found = []
    for words, off in cases:
        errors = (_error(evidence, x, model) for x in _fitted(_with_torques(evidence, truth + off), window))
        found.append(TorqueCase(words, float(np.linalg.norm(off) / np.linalg.norm(truth)), *errors))
    return Amplification(mechanism.name, window, tuple(found), seed)


def _fitted(evidence: LogEvidence, window: float) -> tuple[Array, Array]:
    columns = evidence.independent(SETTINGS)
    x, _ = weighted_least_squares(evidence.equations(SETTINGS, _early(evidence)), columns)
    end = evidence.edges[len(_early(evidence))][1]
    motions = [_until(motion, end) for motion in evidence.motions]
    return x, by_energy(motions, evidence.mechanism, window, columns)


def _early(evidence: LogEvidence) -> range:
    return range(round((1.0 - HELD_OUT_SHARE) * evidence.blocks))


def _until(motion: SmoothMotion, end: float) -> SmoothMotion:
    times = motion.log.time[motion.first :: motion.every][: len(motion.position)]
    count = int(np.sum(times < end))
    return replace(motion, position=motion.position[:count], velocity=motion.velocity[:count])


def _torques(evidence: LogEvidence, x: Array) -> Array:
    (motion,) = evidence.motions
    p, v, a = motion.states()
    torque = evidence.mechanism.with_parameters(x).inverse_dynamics(p, v, a)
    times = motion.log.time[motion.first :: motion.every][: len(motion.position)][DIFFERENCE_MARGIN:-DIFFERENCE_MARGIN]
    return np.stack([np.interp(motion.log.time, times, column) for column in torque.T], axis=-1)


def _model(evidence: LogEvidence) -> Array:
    return evidence.fit(SETTINGS, range(evidence.blocks)).x


def _with_torques(evidence: LogEvidence, torque: Array) -> LogEvidence:
    motions = [replace(motion, log=replace(motion.log, torque=torque)) for motion in evidence.motions]
    rows = dict(
        zip(evidence.rows, rows_of(motions, MomentumBalance(evidence.mechanism), list(evidence.rows)), strict=True)
    )
    return replace(evidence, motions=motions, rows=rows)


def _error(evidence: LogEvidence, x: Array, truth: Array) -> float:
    rows = evidence.rows[CUTOFF].moved
    late: NDArray[np.bool_] = rows.time >= evidence.edges[len(_early(evidence))][1]
    expected = rows.regressor[late] @ truth
    return float(np.linalg.norm(rows.regressor[late] @ x - expected) / np.linalg.norm(expected))
