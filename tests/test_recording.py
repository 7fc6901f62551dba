"""What is written of a comparison can be read back, and says what happened."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rerun as rr
import rerun.blueprint as rrb
from comparisons import PERIOD, comparison, rollout
from random_trees import random_chain
from rerun.chunk import RrdReader
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.description import Joint, JointKind, Pose
from adaptctl.description.drive import Drive
from adaptctl.description.pose import NamedFrame
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import joint_axes, link_poses
from adaptctl.errors import FileError, InputError
from adaptctl.identifiability import essential_space
from adaptctl.recording import Comparison, stream, views, write_artifacts
from adaptctl.recording import shown as result_of
from adaptctl.recording.judgement import facts, final_error, outcome_words
from adaptctl.recording.report import report
from adaptctl.recording.rerun_recording import estimated_links, summary_markdown
from adaptctl.recording.result import answers
from adaptctl.recording.scene import log_base
from adaptctl.recording.skeleton import ROOT_RADIUS, TIP_RADIUS, VIEW_SLOPE, Shape, Solid, Viewpoint, skeleton, with_tip
from adaptctl.recording.trace import quantities
from adaptctl.recording.wording import INCOMPLETE, parameter_unit

FILES = {"recording.rrd", "summary.json", "trace.parquet", "report.html"}
TWO_LINK = "two_link"
FIGURES = {"tracking-error", "joint-errors", "lyapunov", "torque", "parameters", "spectrum"}


@pytest.fixture(scope="module")
def shown() -> Comparison:
    return comparison(load("puma560_measured"))


@pytest.fixture(scope="module")
def folder(shown: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_artifacts(tmp_path_factory.mktemp("run") / "deep" / "er", shown)


def series(path: Path, entity: str) -> tuple[Array, Array]:
    """Times (T,) and curves (T, n) of an entity of a recording."""
    times, values = [], []
    chunks = RrdReader(path).store().stream()
    for chunk in chunks.filter(content=entity, components="Scalars:scalars", is_static=False):
        batch = chunk.to_record_batch()
        times.append(batch["sim_time"].cast(pa.int64()).to_numpy() * 1e-9)
        values.append(batch["Scalars:scalars"].flatten().to_numpy().reshape(batch.num_rows, -1))
    order = np.argsort(np.concatenate(times), kind="stable")
    return np.concatenate(times)[order], np.concatenate(values)[order]


def entities(path: Path) -> set[str]:
    return {str(chunk.entity_path) for chunk in RrdReader(path).store().stream()}


def test_a_result_says_how_a_comparison_ended_and_writes_it(tmp_path: Path) -> None:
    small = comparison(load(TWO_LINK), samples=40)
    whole, half = result_of(small), result_of(replace(small, complete=False))
    assert (whole.complete, half.complete) == (True, False)
    assert (whole.headline, half.headline) == (outcome_words(small), f"{INCOMPLETE}\n{outcome_words(small)}")
    assert whole.facts == tuple(facts(small, by_joint=True))
    shares: list[float] = []
    whole.write(tmp_path, lambda what, share: shares.append(share))
    assert {path.name for path in tmp_path.iterdir()} >= FILES
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_every_file_is_there_and_nothing_else(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == FILES | {"figures"}
    assert {path.name for path in (folder / "figures").iterdir()} == {f"{name}.png" for name in FIGURES}


def test_recording_holds_the_curves_that_were_run(folder: Path, shown: Comparison) -> None:
    time, errors = series(folder / "recording.rrd", "/error/adaptive")
    run = shown.subject.rollout
    np.testing.assert_allclose(time, run.time, atol=1e-9)
    np.testing.assert_array_equal(errors, 1e3 * run.error)
    _, values = series(folder / "recording.rrd", "/lyapunov/adaptive")
    np.testing.assert_array_equal(values[:, 0], shown.subject.lyapunov)
    _, shares = series(folder / "recording.rrd", "/torque_share/joints")
    np.testing.assert_array_equal(shares, run.applied / shown.torque_limits)
    _, limits = series(folder / "recording.rrd", "/torque/joint2/limit")
    np.testing.assert_array_equal(limits, [[-186.4, 186.4]] * 2)


def test_recording_holds_every_estimate_and_its_true_value(folder: Path, shown: Comparison) -> None:
    place = 0
    for link in dict.fromkeys(name.partition(".")[0] for name in shown.basis.names):
        _, estimates = series(folder / "recording.rrd", f"/estimate/{link}/estimate")
        _, truth = series(folder / "recording.rrd", f"/estimate/{link}/truth")
        own = slice(place, place + truth.shape[1])
        np.testing.assert_array_equal(estimates, shown.subject.rollout.estimate[:, own])
        np.testing.assert_array_equal(truth, [shown.true_parameters[own]] * 2)
        place = own.stop
    assert place == len(shown.basis.names)


@pytest.mark.parametrize(
    ("who", "of"),
    [("adaptive", lambda shown: shown.subject.rollout.p), ("desired", lambda shown: shown.subject.rollout.reference_p)],
)
def test_recording_moves_every_link_where_kinematics_put_it(
    folder: Path, shown: Comparison, who: str, of: Callable[[Comparison], Array]
) -> None:
    model, p = shown.mechanism.to_pinocchio(), of(shown)
    data = model.createData()
    chunks = RrdReader(folder / "recording.rrd").store().stream()
    for chunk in chunks.filter(content=f"/world/{who}/link4", is_static=False):
        batch = chunk.to_record_batch()
        ticks = np.round(batch["sim_time"].cast(pa.int64()).to_numpy() * 1e-9 / PERIOD).astype(int)
        places = batch["Transform3D:translation"].flatten().flatten().to_numpy().reshape(-1, 3)
        for tick, place in list(zip(ticks, places, strict=True))[::100]:
            pinocchio.framesForwardKinematics(model, data, p[tick])
            np.testing.assert_allclose(place, data.oMf[model.getFrameId("link4")].translation, atol=1e-6)
        return
    pytest.fail(f"the recording has no moving link4 of {who}")


def test_recording_shows_the_arm_its_ghosts_and_the_offline_stage(folder: Path) -> None:
    found = entities(folder / "recording.rrd")
    for entity in (
        "/world/base",
        "/world/path/desired",
        "/world/trail/adaptive",
        "/world/trail/adaptation-off",
        "/world/desired/link2/link",
        "/world/adaptation-off/link2/joint",
        "/world/adaptive/link6/tool",
        "/error/adaptation-off",
        "/basis/spectrum/essential",
        "/basis/spectrum/null_space",
        "/basis/equations",
        "/summary",
    ):
        assert entity in found


def test_spectrum_stands_above_and_below_the_threshold(folder: Path) -> None:
    heights = {}
    chunks = RrdReader(folder / "recording.rrd").store().stream()
    for chunk in chunks.filter(content="/basis/spectrum/**", is_static=True):
        values = chunk.to_record_batch()["BarChart:values"].to_pylist()[0]
        buffer = np.asarray(values[0]["buffer"], dtype=float)
        heights[str(chunk.entity_path).rpartition("/")[2]] = buffer
    assert (len(heights["essential"]), len(heights["null_space"])) == (36, 24)
    assert heights["essential"].min() > 3.0
    assert heights["null_space"].max() < -3.0


def test_equal_runs_have_equal_recordings_and_different_ones_do_not_mix(tmp_path: Path, shown: Comparison) -> None:
    from adaptctl.recording.rerun_recording import write_recording

    other = replace(
        shown, runs=(replace(shown.subject, rollout=rollout(shown.mechanism, 300, 1.0, np.zeros((300, 36)))),)
    )
    identifiers = []
    for name, what in (("a", shown), ("b", shown), ("c", replace(other, duration=0.6))):
        trimmed = replace(what, runs=tuple(replace(run, lyapunov=None) for run in what.runs))
        write_recording(tmp_path / f"{name}.rrd", trimmed)
        identifiers.append([entry.recording_id for entry in RrdReader(tmp_path / f"{name}.rrd").recordings()])
    assert identifiers[0] == identifiers[1] != identifiers[2]


def test_table_is_lossless_and_names_units(folder: Path, shown: Comparison) -> None:
    table, run = pq.read_table(folder / "trace.parquet"), shown.subject.rollout
    assert table.num_rows == len(run.time)
    for j in range(6):
        for name, values in (("p", run.p), ("v", run.v), ("torque", run.torque), ("error", run.error)):
            np.testing.assert_array_equal(table[f"{name}.joint{j + 1}"].to_numpy(), values[:, j])
        np.testing.assert_array_equal(table[f"reference_p.joint{j + 1}"].to_numpy(), run.reference_p[:, j])
    np.testing.assert_array_equal(table["lyapunov"].to_numpy(), shown.subject.lyapunov)
    np.testing.assert_array_equal(table["energy"].to_numpy(), run.energy)
    for i, name in enumerate(shown.basis.names):
        np.testing.assert_array_equal(table[f"estimate.{name}"].to_numpy(), run.estimate[:, i])
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units["time"] == "s"
    assert units["p.joint1"] == "rad"
    assert units["torque.joint1"] == "N m"
    assert units["estimate.link2.mc_x"] == "kg m"
    assert units["estimate.link2.I_xy"] == "kg m^2"
    assert table.schema.metadata[b"seed"] == b"7"
    assert table.schema.metadata[b"geometry_sha256"].decode() == shown.mechanism.geometry_sha256


def test_summary_says_how_it_went(folder: Path, shown: Comparison) -> None:
    said = json.loads((folder / "summary.json").read_text(), parse_constant=lambda token: pytest.fail(token))
    run, off = shown.subject.rollout, shown.runs[1].rollout
    assert said["schema"] == "adaptctl/summary/4"
    assert said["complete"] is True
    assert (said["experiment"], said["robot"], said["seed"]) == ("by-hand", "puma560_measured", 7)
    assert (said["duration"], said["control_period"]) == (3.0, PERIOD)
    assert said["rms_error"] == pytest.approx(np.sqrt(np.mean(run.error**2)), rel=1e-12)
    last = run.time >= 1.0 - 1e-9
    assert said["final_rms_error"] == pytest.approx(np.sqrt(np.mean(run.error[last] ** 2)), rel=1e-12)
    assert said["final_rms_error_adaptation_off"] == pytest.approx(np.sqrt(np.mean(off.error[last] ** 2)), rel=1e-12)
    assert (said["lyapunov_initial"], said["lyapunov_max_increase"]) == (5.0, 0.0)
    assert said["lyapunov_final"] == shown.subject.lyapunov[-1]
    assert said["realtime_factor"] == pytest.approx(3.0 / 0.25)
    assert list(said["parameters"]) == list(shown.basis.names)
    truth = [entry["true"] for entry in said["parameters"].values()]
    np.testing.assert_array_equal(truth, shown.true_parameters)
    assert [entry["estimate"] for entry in said["parameters"].values()] == run.estimate[-1].tolist()
    assert said["findings"]["difference"] == {"value": 2e-11, "unit": "N m"}


@pytest.mark.parametrize("robot", ["semi_direct_drive", "semi_direct_drive_parallelogram", "puma560_measured"])
def test_arms_stand_on_a_pedestal(robot: str, tmp_path: Path) -> None:
    """A linkage too that does not close, or is singular, with all joints at zero."""
    mechanism, path = load(robot), tmp_path / "base.rrd"
    recording = rr.RecordingStream("test", make_default=False)
    recording.save(path)
    log_base(recording, mechanism, skeleton(mechanism), -0.5)
    recording.flush()
    recording.disconnect()
    assert "/world/base" in entities(path)


def test_every_true_value_is_named_after_its_parameter(folder: Path) -> None:
    chunks = RrdReader(folder / "recording.rrd").store().stream()
    for chunk in chunks.filter(content="/estimate/link2/truth", is_static=True):
        names = chunk.to_record_batch()["SeriesLines:names"].to_pylist()[0]
        assert all(name.endswith(", true") for name in names)
        assert len(set(names)) == len(names) > 1
        return
    pytest.fail("the true values have no names")


def test_drives_of_joints_that_slide_have_units_of_their_own(tmp_path: Path) -> None:
    kinds = (JointKind.PRISMATIC, JointKind.REVOLUTE)
    joints = [Joint(f"j{i}", kind, np.eye(3)[i], drive=Drive(*[0.5] * 6)) for i, kind in enumerate(kinds)]
    tree = random_chain(1, 2).description
    links = tuple(replace(link, joint=joint) for link, joint in zip(tree.links, joints, strict=True))
    shown = comparison(Mechanism(replace(tree, links=links)))
    columns = quantities(shown.subject, shown.mechanism, shown.model.names)
    units = {column.name.removeprefix("estimate."): column.unit for column in columns}
    slides = {"viscous": "N s/m", "coulomb": "N", "square_root": "N s^1/2 m^-1/2", "stribeck": "N", "offset": "N"}
    turns = {"viscous": "N m s", "coulomb": "N m", "square_root": "N m s^1/2", "stribeck": "N m", "offset": "N m"}
    for joint, expected in (("j0", slides), ("j1", turns)):
        assert {kind: units[f"{joint}.{kind}"] for kind in expected} == expected
    assert parameter_unit("j0.rotor_inertia", shown.mechanism) == "kg"
    assert parameter_unit("j1.rotor_inertia", shown.mechanism) == "kg m^2"
    (tmp_path / "parameters.png").write_bytes(b"not looked at")
    page = report(shown).html({"parameters": tmp_path / "parameters.png"})
    assert '<code>j0.viscous</code></td><td class="note">N·s/m</td>' in page


def test_units_and_kinds_of_parameters_are_not_mixed() -> None:
    """Panda's arm turns and its gripper slides; friction's parameters are none of the inertial ones."""
    what = comparison(load(str(urdf("panda.urdf"))), samples=1100)
    run, units = what.subject, what.joints_by_unit
    assert list(units) == ["rad", "m"]
    told_of = [float(part.split()[0]) for part in final_error(what, run).split(" and ")]
    last = run.rollout.error[-1000:]
    expected = [1e3 * np.sqrt(np.mean(last[:, joints] ** 2)) for joints in units.values()]
    assert told_of == pytest.approx(expected, rel=0.01)
    inertial, friction = len(what.space.parameter_names), len(what.model.names) - what.space.rank
    assert friction > 0
    assert answers(facts(what))["Parameters"] == (
        f"{what.space.rank} base parameters of {inertial} inertial parameters, plus {friction} of friction"
    )


def test_of_a_controller_that_estimates_nothing_no_parameters_are_told_to_be_open() -> None:
    learning = comparison(load(str(urdf("panda.urdf"))), samples=400)
    fixed = replace(learning, runs=learning.runs[1:], without_adaptation="")
    assert "Hardly excited" in answers(facts(learning))
    assert "This motion hardly shows" in summary_markdown(learning)
    assert "Hardly excited" not in answers(facts(fixed))
    assert "This motion" not in summary_markdown(fixed)


def test_estimates_of_friction_are_shown_with_the_others(tmp_path: Path) -> None:
    """Energies say nothing of friction, so that the basis does not hold it; controllers estimate it all the same."""
    arm = load(TWO_LINK).description
    rank = essential_space(Mechanism(arm)).rank
    comparison_with_friction = comparison(Mechanism(arm.with_drives(Drive(viscous=2.0, coulomb=0.5))), samples=20)
    out = write_artifacts(tmp_path / "out", comparison_with_friction)
    said = json.loads((out / "summary.json").read_text())["parameters"]
    assert len(said) == rank + 4
    assert said["shoulder.viscous"]["true"] == 2.0
    assert said["elbow.coulomb"]["true"] == 0.5
    _, truth = series(out / "recording.rrd", "/estimate/shoulder/truth")
    assert list(truth[0]) == [2.0, 0.5]
    assert "estimate.shoulder.viscous" in pq.read_table(out / "trace.parquet").column_names
    units = estimated_links(comparison_with_friction)
    assert units["shoulder"] == "N·m·s, N·m"
    assert units["lower"].startswith("kg·m")


def test_interrupted_comparison_says_so_everywhere(tmp_path: Path) -> None:
    what = comparison(load(TWO_LINK), samples=40, complete=False)
    write_artifacts(tmp_path, what)
    said = json.loads((tmp_path / "summary.json").read_text())
    assert said["complete"] is False
    assert said["final_rms_error_adaptation_off"] is None
    assert "was interrupted" in (tmp_path / "report.html").read_text()
    assert pq.read_schema(tmp_path / "trace.parquet").metadata[b"complete"] == b"false"
    documents = RrdReader(tmp_path / "recording.rrd").store().stream().filter(content="/summary", is_static=True)
    text = " ".join(str(chunk.to_record_batch()["TextDocument:text"].to_pylist()) for chunk in documents)
    assert "was interrupted" in text


def test_one_sample_is_enough_to_be_shown(tmp_path: Path) -> None:
    write_artifacts(tmp_path, comparison(load(TWO_LINK), samples=1))
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"figures"}


def test_nothing_run_is_nothing_to_show(shown: Comparison) -> None:
    nothing = replace(shown.subject, rollout=rollout(shown.mechanism, 0, 1.0))
    with pytest.raises(InputError, match="a run with at least one sample"):
        replace(shown, runs=(nothing,))


def test_rises_of_the_lyapunov_function_are_found(shown: Comparison) -> None:
    values = np.array([3.0, 2.0, 2.25, 1.0])
    assert replace(shown.subject, lyapunov=values).lyapunov_max_increase == 0.25
    assert replace(shown.subject, lyapunov=values[:1]).lyapunov_max_increase == 0.0
    assert replace(shown.subject, lyapunov=None).lyapunov_max_increase is None


@pytest.mark.parametrize("window", [PERIOD, 0.1, 100.0])
def test_moving_error_is_the_error_over_what_has_passed(shown: Comparison, window: float) -> None:
    moving, error = shown.subject.moving_rms_error(window), shown.subject.rollout.error
    width = max(1, round(window / PERIOD))
    for k in (0, 1, 49, 700):
        expected = np.sqrt(np.mean(error[max(0, k + 1 - width) : k + 1] ** 2))
        assert moving[k] == pytest.approx(expected, rel=1e-9)


def test_no_file_is_left_half_written(tmp_path: Path, shown: Comparison) -> None:
    from adaptctl.recording.rerun_recording import write_recording

    (tmp_path / "recording.rrd").write_text("the old one")
    rollout = replace(shown.subject.rollout, applied=np.ones((len(shown.subject.rollout.time), 3)))
    broken = replace(shown, runs=(replace(shown.subject, rollout=rollout), shown.runs[1]))
    with pytest.raises(ValueError, match="broadcast"):
        write_recording(tmp_path / "recording.rrd", broken)
    assert [path.name for path in tmp_path.iterdir()] == ["recording.rrd"]
    assert (tmp_path / "recording.rrd").read_text() == "the old one"


def _cut_off(path: Path) -> None:
    raise RuntimeError(f"{path} is cut off")


def _odd(path: Path) -> SimpleNamespace:
    warnings.warn(f"{path} is odd", UserWarning, stacklevel=1)
    return SimpleNamespace(store=lambda: SimpleNamespace(schema=lambda: None))


@pytest.mark.filterwarnings("default")  # as users have them
@pytest.mark.parametrize("reader", [_cut_off, _odd])
def test_a_recording_that_cannot_be_read_back_is_not_kept(
    reader: Callable[[Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: Comparison
) -> None:
    monkeypatch.setattr(stream, "RrdReader", reader)
    layout = views.tabs(rrb.Vertical(views.text("summary", "Summary")))
    with (
        pytest.raises(FileError, match="cannot be read back"),
        stream.saved_stream(tmp_path / "a.rrd", shown, b"", layout) as recording,
    ):
        stream.log_markdown(recording, "summary", "text")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_does_not_depend_on_those_before_it(tmp_path: Path) -> None:
    """Rerun knows the type of a property from the first that is not empty."""
    shown = SimpleNamespace(experiment="by-hand", seed=0, title="", complete=True)
    layout = views.tabs(rrb.Vertical(views.text("summary", "Summary")))
    told = []
    for number, text in enumerate(("", "a fault", "")):
        path = tmp_path / f"{number}.rrd"
        with stream.saved_stream(path, shown, b"", layout, properties={"faults_of_this_test": text}) as recording:
            stream.log_markdown(recording, "summary", "text")
        told.append(any("faults_of_this_test" in str(column) for column in RrdReader(path).store().schema()))
    assert told == [False, True, False]


@pytest.mark.parametrize("robot", ["puma560_measured", "ur5_robot.urdf"])
def test_skeleton_leads_from_joint_to_joint(robot: str) -> None:
    mechanism = load(urdf(robot) if robot.endswith("urdf") else robot)
    p = np.linspace(-0.4, 0.6, mechanism.dof)
    poses, axes, parts = link_poses(mechanism, p), joint_axes(mechanism, p), skeleton(mechanism)
    reached = {
        i: [poses.translations[i] + poses.rotations[i] @ shape.end for shape in parts.shapes if shape.link == i]
        for i in range(mechanism.dof)
    }
    for i, link in enumerate(mechanism.links):
        own = [shape for shape in parts.shapes if shape.link == i]
        joint = next(shape for shape in own if shape.solid is Solid.JOINT)
        middle = poses.translations[i] + poses.rotations[i] @ (joint.start + joint.end) / 2.0
        direction = poses.rotations[i] @ (joint.end - joint.start) / joint.length
        if link.joint.kind.is_revolute:
            np.testing.assert_allclose(middle, axes.positions[i], atol=1e-12)
        np.testing.assert_allclose(direction, axes.directions[i], atol=1e-12)
        if link.parent >= 0 and np.linalg.norm(link.parent_to_joint.translation) > 1e-6:
            gaps = [np.linalg.norm(axes.positions[i] - end) for end in reached[link.parent]]
            assert min(gaps) < 1e-9


def test_a_link_leads_along_its_joints_axis_and_then_across_it_ever_slimmer() -> None:
    chain = random_chain(5, 4)
    parts, pieces = skeleton(chain), {solid: list[Shape]() for solid in Solid}
    for shape in parts.shapes:
        pieces[shape.solid].append(shape)
    axes = [joint.end - joint.start for joint in pieces[Solid.JOINT]]
    for piece in pieces[Solid.LINK]:
        along = abs((piece.end - piece.start) @ axes[piece.link]) / piece.length / np.linalg.norm(axes[piece.link])
        assert along == pytest.approx(1.0) or along == pytest.approx(0.0, abs=1e-9)
    widths = {shape.link: shape.radius / parts.reach for shape in pieces[Solid.LINK]}
    np.testing.assert_allclose(list(widths.values()), np.linspace(ROOT_RADIUS, TIP_RADIUS, 4))
    tipped = with_tip(parts, 1, np.array([0.3, 0.4, 1.2]))
    assert tipped.reach == pytest.approx(parts.reach + 1.3)
    again = with_tip(tipped, 1, np.array([0.3, 0.4, 1.7]))
    assert again.reach == pytest.approx(parts.reach + 1.8)


def test_the_tip_is_the_farthest_frame_that_has_a_name() -> None:
    """Two links of 0.4 and 0.3 m; 0.5 m on, beside a nearer one."""
    arm = load(TWO_LINK).description
    assert skeleton(Mechanism(arm)).reach == pytest.approx(0.7)
    places = {"far": 0.5, "near": 0.1}
    frames = [NamedFrame(name, 1, Pose(np.eye(3), np.array([x, 0.0, 0.0]))) for name, x in places.items()]
    parts = skeleton(Mechanism(replace(arm, frames=tuple(frames))))
    np.testing.assert_allclose(parts.tip, [0.5, 0.0, 0.0])
    assert parts.reach == pytest.approx(1.2)


def test_all_that_moves_is_seen_from_the_viewpoint() -> None:
    arm = load(TWO_LINK)
    parts = skeleton(arm)
    p = np.random.default_rng(0).uniform(-3.0, 3.0, (100, arm.dof))
    seen = Viewpoint.of(arm, parts, p)
    poses = link_poses(arm, p)
    tips = poses.translations[:, parts.tip_link] + poses.rotations[:, parts.tip_link] @ parts.tip
    axis = (seen.eye - seen.target) / np.linalg.norm(seen.eye - seen.target)
    ahead = (seen.eye - tips) @ axis
    beside = np.linalg.norm((seen.eye - tips) - ahead[:, None] * axis, axis=-1)
    assert np.all(beside <= (VIEW_SLOPE + 1e-9) * ahead)


def test_a_recording_says_of_what_geometry_and_content_it_is(folder: Path, shown: Comparison) -> None:
    chunks = RrdReader(folder / "recording.rrd").store().stream()
    texts = {str(chunk.to_record_batch().to_pylist()) for chunk in chunks if "adaptctl" in str(chunk.entity_path)}
    positions = np.ascontiguousarray(shown.subject.rollout.p).tobytes()
    for wanted in (shown.mechanism.geometry_sha256, hashlib.sha256(positions).hexdigest()):
        assert any(wanted in text for text in texts)
