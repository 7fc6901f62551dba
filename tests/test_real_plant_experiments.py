"""Experiments on plants like real ones: what each was made to show, at a length that takes seconds."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from comparisons import comparison, no_progress, shown
from nightly import at_night, nightly

from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Learning, Outcome
from adaptctl.experiments.identify_then_adapt import IdentifyThenAdapt
from adaptctl.experiments.laws import Laws, Recovery, _rubbed
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.recording import drawing
from adaptctl.recording.report import write_artifacts


def found(content: dict[str, Any], name: str) -> float:
    return float(content["findings"][name]["value"])


def test_frozen_while_saturated_the_error_is_at_most_a_tenth() -> None:
    content = shown(Laws(disturbance="saturation"))
    assert found(content, "freeze_over_none") < 0.1
    assert found(content, "rms_error_after.gradient") < 0.1 * found(content, "rms_error_after.never-frozen")
    assert content["runs"]["gradient"]["final_rms_error"] < 2e-3 < content["runs"]["never-frozen"]["final_rms_error"]
    assert 0.0 < found(content, "saturated.gradient") < 0.5
    assert found(content, "largest_estimate.never-frozen") > 100.0 * found(content, "largest_estimate.gradient")
    assert content["runs"]["gradient"]["clipped_steps"] > 0  # the guard clips, which is told all the same
    assert content["verdict"]["passed"]
    assert [fault["failure"] for fault in content["verdict"]["faults"]] in ([], ["saturated"])


def test_friction_is_learned_where_there_are_columns_for_it() -> None:
    content = shown(Laws(disturbance="friction", duration=6.0))
    assert found(content, "columns_over_none") < 0.1
    assert content["runs"]["gradient"]["final_rms_error"] < 2e-3
    assert found(content, "learned.joint1.coulomb") == pytest.approx(25.98, rel=0.3)
    with_friction, without = (content["runs"][f"computed-torque-{end}"]["rms_error"] for end in ("true", "smooth"))
    assert with_friction < 0.2 * without


def test_a_run_that_is_missing_has_a_dash_in_the_answer_on_friction() -> None:
    experiment = Laws(disturbance="friction")
    mechanism = experiment.mechanism()
    basis = fundamental_basis(essential_space(mechanism))
    words = _rubbed(experiment, Outcome(mechanism, (), complete=True), basis).answer
    assert words is not None
    assert words.count("–") == 3


def test_a_payload_is_learned_and_forgotten() -> None:
    """From a rough model these come back after either event; the same without adaptation does not."""
    laws = ("gradient", "natural")
    content = shown(Laws(disturbance="payload", laws=laws, duration=24.0, payload_start=6.0, payload_stop=15.0))
    for law in laws:
        assert 0.0 <= found(content, f"return_after_pickup.{law}") < (8.0 if law == "gradient" else 5.0)
        assert 0.0 <= found(content, f"return_after_drop.{law}") < 5.0
    assert found(content, "smallest_eigenvalue.natural") > 0.0
    assert found(content, "not_back_after_pickup.adaptation-off") > 2.0
    assert content["final_rms_error"] < 0.3 * content["final_rms_error_adaptation_off"]


@nightly
def test_without_excitation_the_gradient_drifts_and_a_leak_holds() -> None:
    laws = ("sigma-modification", "gradient")
    settings = {"seed": 2, "duration": 60.0, "control_period": 4e-3, "position_noise": 4e-4, "leakage": 1.0}
    content = shown(
        Laws(disturbance="noise", laws=laws, **settings)
    )  # a loop whose last bits decide its counts: bounds are wide
    assert found(content, "drift.gradient") > 5.0 * found(content, "drift.sigma-modification")
    assert found(content, "parameter_error.gradient") > 2.0 * found(content, "parameter_error.sigma-modification")
    assert found(content, "delay") < found(content, "delay_margin")
    assert content["final_rms_error"] < 5e-3


def test_where_no_law_adapts_there_is_no_sentence_on_those_that_do() -> None:
    assert Laws(disturbance="noise", laws=("computed-torque",), duration=0.5).compare(no_progress).answer is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Laws(disturbance="saturation", payload_start=9.0, payload_stop=6.0),
            "a release after it within the 20 s of the run, got 9 and 6",
        ),
        (
            lambda: Laws(disturbance="payload", payload_start=1.0),
            "payload_start, payload_stop: expected a pickup at 2 s or later",
        ),
        (lambda: Laws(disturbance="payload", laws=("guesswork",)), "laws: unknown law 'guesswork'"),
        (lambda: Laws(disturbance="rain"), "disturbance: expected one of none, payload, noise,"),
        (lambda: Laws(joint_stiffness=(0.0, 1e3)), "joint_stiffness: expected positive numbers, or only 0"),
        (lambda: Laws(disturbance="noise", delay=65), "delay: expected a whole number from 0 to 64, got 65"),
    ],
)
def test_settings_that_cannot_be_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_what_is_given_is_not_set_by_a_disturbance() -> None:
    """Its own defaults included; what is replaced later stays as it was."""
    assert (Laws().dead_zone, Laws(disturbance="payload").dead_zone) == (0.02, 0.08)
    assert Laws(disturbance="payload", dead_zone=0.02).dead_zone == 0.02
    assert replace(Laws(disturbance="noise"), seed=3) == Laws(disturbance="noise", seed=3)
    with pytest.raises(TypeError, match="Laws has no setting 'colour'"):
        Laws(colour="blue")


@pytest.mark.parametrize(
    ("experiment", "message"),
    [
        (Laws(disturbance="friction", robot="puma560_geared"), "puma560_geared has no joint friction"),
        (
            Laws(disturbance="saturation", robot="semi_direct_drive"),
            "semi_direct_drive has 3 joints, but this experiment needs 6",
        ),
    ],
)
def test_arms_that_do_not_fit_are_refused(experiment: Learning, message: str) -> None:
    with pytest.raises(InputError, match=message):
        experiment.compare(no_progress)


def test_a_run_becomes_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from adaptctl.cli.main import main

    written = drawing._written
    monkeypatch.setattr(drawing, "_written", lambda folder, drawings, *how: written(folder, drawings[:1], *how))
    out = tmp_path / "out"
    command = [
        "experiment",
        "run",
        "laws",
        "--disturbance",
        "saturation",
        "--out",
        str(out),
        "--duration",
        "1",
        "--payload-start",
        "0.2",
        "--payload-stop",
        "0.6",
        "--figures",
    ]
    assert main(command) == 0
    content = json.loads((out / "summary.json").read_text())
    assert math.isfinite(content["findings"]["freeze_over_none"]["value"])
    assert (out / "figures" / "parameter-error.png").is_file()
    assert (out / "figures" / "parameter-error.pdf").read_bytes().startswith(b"%PDF")
    assert "<svg" in (out / "figures" / "parameter-error.svg").read_text()
    trace = pq.read_table(out / "trace.parquet")
    held = trace["flag.payload"].to_numpy()
    np.testing.assert_array_equal(held[[0, 150, 250, 550, 650, 999]], [0.0, 0.0, 4.0, 4.0, 0.0, 0.0])
    assert trace.schema.field("flag.payload").metadata[b"unit"] == b"kg"
    assert set(trace["flag.frozen"].to_numpy()) <= {0.0, 1.0}
    page = (out / "report.html").read_text()
    assert "With adaptation frozen during saturation, the RMS error of the run is" in page
    assert "<th" in page.partition("rms error after")[0].rpartition("<tr>")[2]  # a column of one table


class EndsEarly(Laws):
    """Of which every run ends before the payload is dropped."""

    error_bound = 1e-3


@nightly
def test_a_run_that_ends_before_the_drop_says_so_and_has_no_error_after_it(tmp_path: Path) -> None:
    write_artifacts(tmp_path, EndsEarly(disturbance="saturation", duration=9.0).compare(no_progress))
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["duration_run"] < 2.0
    assert [fault["failure"] for fault in content["verdict"]["faults"]] == ["stopped"]
    assert "freeze_over_none" in content["findings"]
    assert not [name for name in content["findings"] if name.startswith("rms_error_after")]


@pytest.mark.parametrize(
    ("experiment", "zero", "ratio"),
    [
        (EndsEarly(disturbance="saturation", duration=9.0), "rms_error_after.gradient", "freeze_over_none"),
        (Laws(disturbance="noise", laws=("gradient",), duration=0.2), "true_rms_error.gradient", ""),
        at_night((IdentifyThenAdapt(duration=2.5), "first_error.adaptive", "zero_over_identified")),
    ],
)
def test_an_error_of_zero_is_zero(experiment: Learning, zero: str, ratio: str) -> None:
    """All findings are numbers, and a ratio to no error is left out."""
    compared = experiment.compare(no_progress)
    runs = [replace(run, rollout=replace(run.rollout, p=run.rollout.reference_p)) for run in compared.runs]
    outcome = Outcome(compared.mechanism, tuple(runs), complete=True)
    said = experiment.told(outcome, compared.basis)
    told = {one.name: one.value for one in said.findings}
    assert told
    assert all(math.isfinite(value) for value in told.values())
    assert ratio not in told
    assert told.get(zero, 0.0) == 0.0
    assert "nan" not in (said.answer or "")


def test_what_has_no_samples_before_the_next_event_has_no_error_left() -> None:
    made = comparison(load("puma560_measured")).runs[0]
    assert Recovery.of(made, "drop", 0.1, 2.9991, 2.9995).left is None
    exact = replace(made, rollout=replace(made.rollout, p=made.rollout.reference_p))
    assert Recovery.of(exact, "drop", 0.1, 0.5, 2.9).left == 0.0
