"""Results print as one line without arrays of numbers."""

from __future__ import annotations

import numpy as np
import pytest

import adaptctl
from adaptctl.design import Counterweights, DesignStudy, DesignTask, MountingBounds, added_mass, point, simplifications
from adaptctl.envs import TrackingEnv
from adaptctl.identifiability import ConsistentParameters, States
from adaptctl.identification import Validation
from adaptctl.identification.columns import joint_columns
from adaptctl.identification.log_files import table
from adaptctl.identification.robot_motion import RobotMotion
from adaptctl.recording import compared_runs


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def test_offline_results_print_as_one_line(arm: adaptctl.Mechanism) -> None:
    space = adaptctl.essential_space(arm)
    basis = adaptctl.fundamental_basis(space)
    model = adaptctl.ReducedModel(arm, basis)
    beta = model.fundamental_parameters
    assert repr(space) == "<EssentialSpace of 'two_link': rank 6 of 20 parameters>"
    assert repr(basis) == "<FundamentalBasis of 'two_link': 6 of 20 parameters>"
    assert repr(model) == "<ReducedModel of 'two_link': 6 of 20 parameters>"
    assert repr(adaptctl.reduce(space, arm, components=6)).startswith("<Reduction to 6 of 6 components: energy error ")
    assert repr(States(np.zeros((5, 2)), np.zeros((5, 2)), "at rest")) == "<States of 2 joints: at rest>"
    assert (
        repr(ConsistentParameters(np.asarray(arm.inertial_parameters), beta, beta))
        == "<ConsistentParameters: 20, distance 0>"
    )


def test_results_of_logs_and_motions_print_as_one_line(arm: adaptctl.Mechanism) -> None:
    measured = np.array([[1.0], [2.0]])
    validation = Validation("a test", 25.0, np.array([0.0, 0.1]), measured, 1.1 * measured)
    assert repr(validation) == "<Validation on 2 rows: torque error 10.00%>"
    reference = adaptctl.Sinusoids(center=[0.3, 0.5], amplitude=[0.4, 0.3], frequency=[0.5, 0.8])
    motion = RobotMotion(reference, np.zeros(2), np.zeros(2), period=10.0, fade=2.0)
    assert repr(motion) == "<RobotMotion of 2 joints: 14 s>"
    names = ("time", *(f"{what}.{joint}" for what in ("position", "torque") for joint in ("shoulder", "elbow")))
    log = table("a log", [(name, np.arange(3.0)) for name in names])
    drives = joint_columns(arm, log, units={"time": "s", "position": "rad", "torque": "N m"})
    assert repr(drives) == "<Drives of 2 joints>"
    env = TrackingEnv(arm, reference, duration=0.02)
    law = adaptctl.SlotineLi(
        adaptctl.ReducedModel(arm),
        bandwidth=5.0,
        damping=[6.0, 2.0],
        adaptation=np.full(6, 0.1),
    )
    comparison = compared_runs(arm, {"adaptive": adaptctl.rollout(env, law, seed=0)})
    assert repr(comparison) == "<Comparison 'runs': 1 runs of 'two_link'>"
    assert repr(comparison.subject).startswith("<ControllerRun 'run1': 0.02 s")


def test_results_of_design_print_as_one_line(arm: adaptctl.Mechanism) -> None:
    task, bounds = DesignTask.within_limits(arm, samples=20), MountingBounds.for_link(arm, "lower")
    balls = Counterweights(task, "energy", 1.0, (), (), 0)
    changes = simplifications(task, [bounds])
    assert repr(task).startswith("<DesignTask of 'two_link': 20 random states ")
    assert repr(added_mass(task, "lower", 0.5)) == "<AddedMass of 0.5 kg on 'lower' of 'two_link'>"
    assert repr(balls) == "<Counterweights on 'two_link': 0 for energy>"
    assert repr(changes[0]) == "<Simplification: lower is symmetric along y already>"
    assert repr(DesignStudy(task, point(1.0), (bounds,), 1.0, balls, changes)) == "<DesignStudy of 'two_link': 1 links>"


def test_a_runs_figure_has_the_robots_names_and_units(arm: adaptctl.Mechanism) -> None:
    env, law = TrackingEnv(arm, 3, duration=0.02), adaptctl.ComputedTorque(arm, 8.0)
    for run in (adaptctl.rollout(env, law, seed=0), adaptctl.simulate(env, law, seed=0)):
        figure = run.plot()
        assert [axes.get_ylabel() for axes in figure.axes] == ["position [rad]", "error [mrad]", "torque [N m]"]
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["shoulder", "elbow"]
    assert [text.get_text() for text in run.plot(["a", "b"]).legends[0].get_texts()] == ["a", "b"]
