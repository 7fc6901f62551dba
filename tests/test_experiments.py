"""Experiments as a user runs them: by the command line, through the Gymnasium environment, into a folder."""

from __future__ import annotations

import contextlib
import importlib
import json
import signal
import sys
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest
from comparisons import no_progress, shown
from nightly import at_night, mostly_at_night
from robot_files import urdf
from signals import signalled

from adaptctl.cli.interruption import IMPORTING, interruptible
from adaptctl.cli.main import main
from adaptctl.control import ComputedTorque, SlotineLi, sampled_gain
from adaptctl.description import builtin_file
from adaptctl.dynamics import load
from adaptctl.errors import GainError, InputError, NotFoundError
from adaptctl.experiments import EXPERIMENTS, find
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.experiments.contest import NO_MODEL, Contender, contest
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording.trace import write_trace
from adaptctl.tuning import tune

PUMA = ("experiment", "run", "puma560-adaptive")
SMALL = ("experiment", "run", "adaptive", "--robot", "puma560_arm3")
"""An arm of three joints, where what is claimed is of any arm."""
NAMES = (
    "learning",
    "adaptive",
    "adaptation-off",
    "computed-torque",
    "computed-torque-wrong",
    "pd-gravity",
    "adaptive-full",
    "adaptive-mapped",
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs") / "puma"


@pytest.fixture(scope="module")
def said(out: Path) -> dict[str, Any]:
    """The summary of the first 4 s of the PUMA's experiment, run by the command line."""
    assert main([*PUMA, "--out", str(out), "--duration", "4", "--seed", "3"]) == 0
    return json.loads((out / "summary.json").read_text())


def test_every_controller_drives_the_same_run(said: dict[str, Any]) -> None:
    assert said["complete"] is True
    assert tuple(said["runs"]) == NAMES
    assert said["seed"] == 3
    assert all(run["duration"] == 4.0 for run in said["runs"].values())


def test_it_learns_within_the_limits_and_the_lyapunov_function_never_rises(said: dict[str, Any]) -> None:
    assert said["lyapunov_max_increase"] == 0.0
    assert said["lyapunov_final"] < said["lyapunov_initial"]
    assert said["clipped_steps"] == 0
    assert said["peak_torque_share"] < 0.85  # 0.7 with the gradient, which learns more slowly
    assert said["final_rms_error"] < 0.2 * said["first_rms_error"]
    assert said["final_rms_error"] < 0.2 * said["final_rms_error_adaptation_off"]
    assert said["final_rms_error"] < 0.2 * said["runs"]["adaptive"]["final_rms_error"]
    assert said["runs"]["adaptive"]["first_rms_error"] == pytest.approx(28.7e-3, abs=1e-4)


def test_true_model_tracks_best_and_wrong_one_does_not(said: dict[str, Any]) -> None:
    final = {name: run["final_rms_error"] for name, run in said["runs"].items()}
    assert final["computed-torque"] < 1e-4
    assert final["computed-torque-wrong"] > 10.0 * final["adaptive"]


def test_reduced_and_full_adaptation_are_one_controller(said: dict[str, Any]) -> None:
    assert said["findings"]["torque_difference_reduced_full"]["value"] < 1e-10
    reduced, full = said["runs"]["adaptive-mapped"], said["runs"]["adaptive-full"]
    assert reduced["final_rms_error"] == pytest.approx(full["final_rms_error"], rel=1e-9)
    assert said["runs"]["adaptive"]["tick"]["flops"] < full["tick"]["flops"]


def test_summary_knows_the_parameters_and_settings(said: dict[str, Any]) -> None:
    assert (said["rank"], len(said["parameters"])) == (36, 36)
    mechanism = load("puma560_measured")
    assert said["parameters"]["link6.I_zz"]["true"] == pytest.approx(0.178)
    assert len(mechanism.links) == 6
    assert said["settings"]["K"] == "90, 150, 70, 20, 16, 18"
    assert said["settings"]["Γ"] == "0.6·(5 kg)²; 0.6·(2 kg·m)²; 0.6·(0.6 kg·m²)²"
    assert said["settings"]["--duration"] == "4"
    assert 0.0 < said["wall_time"] < 60.0
    assert said["realtime_factor"] == pytest.approx(4.0 / said["wall_time"])


def test_table_starts_off_the_reference_and_knowing_nothing(out: Path, said: dict[str, Any]) -> None:
    table = pq.read_table(out / "trace.parquet")
    assert table.num_rows == 4000
    for j in range(6):
        assert table[f"error.joint{j + 1}"][0].as_py() == pytest.approx(0.1)
    estimates = [table[name][0].as_py() for name in table.column_names if name.startswith("estimate.")]
    assert estimates == [0.0] * 36
    assert said["lyapunov_initial"] == table["lyapunov"][0].as_py()


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_equal_seeds_give_equal_runs(out: Path, said: dict[str, Any], tmp_path: Path) -> None:
    write_trace(tmp_path / "trace.parquet", Puma560Adaptive(duration=0.5, seed=3).compare(no_progress))
    again, before = pq.read_table(tmp_path / "trace.parquet"), pq.read_table(out / "trace.parquet")
    assert again.equals(before.slice(0, 500), check_metadata=False)


def test_a_folder_is_written_again_only_when_told(
    out: Path, said: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*PUMA, "--out", str(out), "--duration", "0.1"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert json.loads((out / "summary.json").read_text()) == said


def test_outcome_and_places_are_printed_and_notes_are_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "short"
    assert main([*SMALL, "--out", str(folder), "--duration", "0.05", "--seed", "5"]) == 0
    shown = capsys.readouterr()
    assert "RMS error" in shown.out
    assert f"rerun {folder / 'recording.rrd'}" in shown.out
    notes = [line for line in shown.err.splitlines() if line.startswith("adaptctl: note: puma560_arm3: physically")]
    assert len(notes) == 1
    assert "Warning" not in shown.err
    assert json.loads((folder / "summary.json").read_text())["seed"] == 5


# Where the signal lands in a callback of Python's own, Python reports the exception and drops it; the run must end
# well all the same, which is what is tested.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", mostly_at_night([signal.SIGINT, signal.SIGTERM], signal.SIGTERM))
def test_interrupted_run_keeps_what_was_computed(
    number: signal.Signals, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with signalled("EpisodeRun._taken", number, after=0.3):
        assert main([*SMALL, "--out", str(tmp_path / "out"), "--duration", "300"]) == 130
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert said["complete"] is False
    assert list(said["runs"]) == ["learning"]
    assert 0.0 < said["duration_run"] <= said["duration"] == 300.0
    table = pq.read_table(tmp_path / "out" / "trace.parquet")
    spacing = int(table.schema.metadata[b"every"]) * 1e-3
    assert table.num_rows == round(said["duration_run"] / spacing)
    assert "was interrupted" in (tmp_path / "out" / "report.html").read_text()
    shown = capsys.readouterr()
    assert "interrupted; writing what was computed" in shown.err
    assert "Traceback" not in shown.err


def test_run_interrupted_before_anything_was_computed_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with signalled("essential_space", signal.SIGINT):
        assert main([*PUMA, "--out", str(tmp_path / "out"), "--duration", "300"]) == 130
    assert not (tmp_path / "out").exists()
    assert capsys.readouterr().err.splitlines()[-1] == "adaptctl: interrupted"


def test_interruption_that_python_lost_is_found_again_in_the_midst_of_the_next_stage() -> None:
    stages = []
    with interruptible() as interruption:
        told = interruption.heeded(lambda what, share: stages.append((what, share)))
        told("one", 0.5)
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        told("one", 1.0)
        with pytest.raises(KeyboardInterrupt):
            told("two", 0.0)
    assert stages == [("one", 0.5), ("one", 1.0)]
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_an_interruption_in_the_midst_of_pythons_imports_waits_until_they_let_go_of_their_lock() -> None:
    inside = compile("signal.raise_signal(signal.SIGINT)\nsteps.append('released')", IMPORTING, "exec")
    steps: list[str] = []

    def imported() -> None:
        exec(inside, {"signal": signal, "steps": steps})
        time.sleep(60.0)

    with interruptible(), pytest.raises(KeyboardInterrupt):
        imported()
    assert steps == ["released"]


def test_an_interruption_in_a_class_that_an_import_defines_is_one_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python 3.11 makes a RuntimeError of what is raised in `__set_name__`."""
    field = "class Field:\n    def __set_name__(self, kind, name):\n        signal.raise_signal(signal.SIGINT)\n"
    text = f"import signal\n{field}class Kind:\n    field = Field()\nDEFINED = True\n"
    (tmp_path / "interrupted_module.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)

    def imported() -> None:
        importlib.import_module("interrupted_module")
        time.sleep(60.0)

    with interruptible(), pytest.raises(KeyboardInterrupt):
        imported()
    assert sys.modules.pop("interrupted_module").DEFINED


@pytest.mark.filterwarnings("ignore:.*URDF has no rotor inertias:adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("robot", ["two_link", at_night("puma560_measured"), at_night("ur5_robot.urdf")])
def test_any_arm_learns_with_gains_from_its_own_inertia_and_limits(robot: str) -> None:
    source = str(urdf(robot)) if robot.endswith("urdf") else robot
    said = shown(AdaptiveTracking(robot=source, duration=6.0))
    assert said["lyapunov_max_increase"] < 1e-2 * said["lyapunov_initial"]  # held torques are right to first order
    assert said["clipped_steps"] == 0
    assert said["final_rms_error"] < 0.5 * said["final_rms_error_adaptation_off"]
    assert "reference frequency" in said["settings"]


def test_many_parameters_are_adapted_by_the_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = load("two_link")
    basis = fundamental_basis(essential_space(mechanism))
    kind, first = AdaptiveTracking(robot="two_link"), []
    for limit in (len(basis.names), len(basis.names) - 1):
        monkeypatch.setattr("adaptctl.experiments.puma560_adaptive.MAX_LEARNED", limit)
        first.append(kind.contenders(mechanism, basis)[0].label)
    assert first == ["Learning, 6 parameters", "Gradient, 6 parameters"]


def test_a_weak_arm_starts_no_further_off_than_its_torques_bring_back(tmp_path: Path) -> None:
    text = builtin_file("two_link").read_text()
    flat = "\n".join(line for line in text.splitlines() if not line.startswith("base"))
    (robot := tmp_path / "weak.toml").write_text(flat.replace("60.0", "0.03").replace("25.0", "0.03"))
    mechanism = load(robot)
    wanted = tune(mechanism).initial_error
    assert wanted[0] < 0.03 < wanted[1]
    env = AdaptiveTracking(robot=str(robot)).environment(mechanism)
    np.testing.assert_allclose(env.unwrapped.initial_error, wanted)  # type: ignore[attr-defined]  # the environment's own
    asked = AdaptiveTracking(robot=str(robot), initial_error=0.05).tuning(mechanism)
    np.testing.assert_allclose(asked.initial_error, 0.05)


def test_gains_of_any_arm_hold_what_the_control_period_asks() -> None:
    mechanism = load("puma560_measured")
    experiment = AdaptiveTracking(control_period=2e-3)
    model = ReducedModel(mechanism)
    gains = experiment.gains(mechanism)
    controller = SlotineLi(
        model, gains.bandwidth, gains.damping, experiment.adaptation(model), control_period=experiment.control_period
    )
    assert sampled_gain(mechanism, gains.damping, experiment.control_period) < 2.0
    assert controller.adaptation is not None
    assert np.linalg.eigvalsh(controller.adaptation)[0] > 0.0


@pytest.mark.parametrize("entry", EXPERIMENTS, ids=lambda entry: entry.name)
def test_every_experiment_has_its_name_and_documents_its_settings(entry: Any) -> None:
    kind = find(entry.name)
    assert kind.name == entry.name
    assert kind.__doc__
    for field in fields(kind):
        assert len(field.metadata["meaning"]) > 3
    assert kind() == kind()


@pytest.mark.parametrize("entry", EXPERIMENTS, ids=lambda entry: entry.name)
def test_the_defaults_of_settings_are_sound(entry: Any) -> None:
    kind = find(entry.name)
    for one in fields(kind):
        default: Any = one.default
        values = default if isinstance(default, tuple) else (default,)
        numbers = [x for x in values if isinstance(x, int | float) and not isinstance(x, bool)]
        assert all(one.metadata["low"] <= x <= one.metadata["high"] for x in numbers)
        assert all(np.isfinite(numbers))
    kind(**{one.name: (*one.default,) for one in fields(kind) if isinstance(one.default, tuple)})


def test_what_cannot_be_made_is_told_before_anything_runs() -> None:
    mechanism = load("puma560_measured")
    ran: list[str] = []

    def stiff() -> SlotineLi:
        return SlotineLi(ReducedModel.full(mechanism), 8.0, 1e5)

    contenders = [
        Contender.of("good", "Good", "exact", ComputedTorque(mechanism, 8.0)),
        Contender("stiff", "Stiff", NO_MODEL, stiff),
    ]
    env: Any = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=mechanism, reference=1, duration=0.01)
    with pytest.raises(GainError, match="too stiff"):
        contest(env, mechanism, contenders, 0, lambda what, share: ran.append(what))
    assert ran == []


def test_unknown_experiment_is_told_what_exists() -> None:
    with pytest.raises(NotFoundError, match="experiments: puma560-adaptive, "):
        find("nonsense")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"duration": True}, "duration: expected a number from 0.01 to 300, got True"),
        ({"duration": "20"}, "duration: expected a number from 0.01 to 300, got '20'"),
        ({"duration": None}, "duration: expected a number from 0.01 to 300, got None"),
        ({"seed": 1.5}, "seed: expected a whole number"),
        ({"damping": 90.0}, "damping: expected numbers from 0.001 to 10000, got 90.0"),
        ({"damping": ()}, "damping: expected numbers"),
        ({"bandwidth": (8.0,)}, "bandwidth: expected a number"),
        ({"robot": 560}, "robot: expected a name or a file, got 560"),
    ],
)
def test_settings_are_checked_in_python_too(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError) as refusal:
        Puma560Adaptive(**settings)
    assert told in str(refusal.value)


def test_a_run_that_stops_ends_with_the_exit_code_of_a_failed_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main([*PUMA, "--out", str(out), "--duration", "3", "--initial-error", "0.99", "--damping", *6 * ["1"]]) == 3
    said = json.loads((out / "summary.json").read_text())
    assert capsys.readouterr().out.startswith("Failed: Learning, 36 parameters was stopped by the environment at ")
    assert (said["complete"], said["verdict"]["passed"], said["final_rms_error"]) == (True, False, None)
    assert said["duration_run"] < 2.0
    assert said["verdict"]["faults"][0]["failure"] == "stopped"
