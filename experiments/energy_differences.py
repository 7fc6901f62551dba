"""Energy differences as an estimator on a real log: exact in theory, and what they make of torques that are off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.experiments.experiment import Experiment, setting
from adaptctl.identification.amplification import Amplification, Curves, TorqueCase
from adaptctl.identification.energy_differences import by_energy
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.recording import Progress, Result
from adaptctl.recording.result import Verdict

STAGE = "Estimators"
FRICTION = "viscous,coulomb,square_root"
HELD_OUT = 0.4
WEIGHT, CUTOFF = 5.0, 25.0


@dataclass(frozen=True)
class EnergyDifferences(Experiment):
    """Experiment that compares two estimators of inertial parameters on a real robot's log, by how errors of the logged
    torques become errors of the torques that the estimates predict. One is energy differences, by which the change of
    energy over a window of `window` (s) equals the joints' work; the other is filtered dynamics, the equations of
    motion behind a low-pass filter. Torques are taken without errors, with noise, and as measured.

    Raises `InputError` at construction for a setting of the wrong type or out of its bounds, `NonFiniteError` for NaN
    or infinity.
    """

    name: ClassVar[str] = "energy-differences"
    title: ClassVar[str] = "{robot}: parameters from energy differences"

    robot: str = setting("tx40", "an example that comes with a real log")
    window: float = setting(0.1, "length of an energy difference, s", low=0.01, high=2.0)

    def run(self, progress: Progress) -> Result:
        """Result of comparing the two estimators of inertial parameters, energy differences and filtered dynamics, a
        `Result`: outcome in words, facts (questions with answers), an empty verdict, since no controller runs, and a
        function that writes the result files into a folder that it is given. `progress(what, share)` is called with the
        step's name and the fraction done, 0 to 1. Raises `NotFoundError` for a `robot` that is not the name of an
        example with a log."""
        found = self.compare(progress)
        return Result(found.complete, found.headline(), tuple(found.facts()), Verdict(), found.write)

    def compare(self, progress: Progress) -> Amplification:
        """Errors of two estimators of inertial parameters, energy differences and filtered dynamics, an
        `Amplification`. A model fitted to the whole log is taken as the truth; each estimator is fitted to the first 60
        % of the log and predicts the torques tau of the rest, with the error |predicted tau - true tau| / |true tau|
        (no unit), tau being those of all joints and samples in one vector, low-pass filtered at 25 Hz. This is done
        with five kinds of torques in the log: the true ones; these with white noise of 1 % and of 5 % of each joint's
        RMS torque; these with a tenth of the residual, measured less true torques; and the measured ones.
        `progress(what, share)` is called with the step's name and the fraction done, 0 to 1. Raises `NotFoundError` for
        a `robot` that is not the name of an example with a log."""
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
            found.append(TorqueCase(words, float(np.linalg.norm(off) / np.linalg.norm(truth)), *errors))
            progress(STAGE, (i + 1) / len(cases))
        title = self.title.format(robot=evidence.mechanism.name)
        return Amplification(
            self.name, title, self.window, tuple(found), _curves(evidence, momentum, energy), self.seed
        )

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
    """Evidence of an example's log, and the log."""
    from adaptctl.identification.columns import joint_log
    from adaptctl.identification.drives_file import read_drives
    from adaptctl.identification.examples import example
    from adaptctl.identification.identify import gathered
    from adaptctl.identification.log_files import read_log

    with example(name) as files:
        mechanism = load(files.robot, snap=True)
        drives = read_drives(files.drives).of(mechanism)
        log = joint_log(read_log(files.log), drives)
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
    """Relative error of the torques on the log's last part, against the true model's."""
    rows = evidence.rows[CUTOFF]
    late: NDArray[np.bool_] = rows.time >= evidence.edges[len(_early(evidence))][1]
    expected = rows.regressor[late] @ truth
    return float(np.linalg.norm(rows.regressor[late] @ x - expected) / np.linalg.norm(expected))


def _curves(evidence: LogEvidence, momentum: Array, energy: Array) -> Curves:
    rows = evidence.rows[CUTOFF]
    late = rows.time >= evidence.edges[len(_early(evidence))][1]
    Y = rows.regressor[late]
    joints = tuple(joint.name for joint in evidence.mechanism.primary_joints)
    return Curves(joints, rows.time[late], rows.torque[late], Y @ momentum, Y @ energy)
