"""What an identification writes: robot, estimates, validation, report and recording, each whole and in agreement."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio
import pyarrow.parquet as pq
import pytest
from nightly import nightly
from random_trees import random_chain
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from synthetic_logs import joint_drives, motion

from adaptctl.arrays import Array
from adaptctl.cli.main import main
from adaptctl.description import JointKind, Limits
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.description.readers.registry import builtin_names
from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.description.writers.robot_file import with_inertials, write_urdf
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.drive import friction
from adaptctl.errors import FileError
from adaptctl.experiments.identify_then_adapt import IdentifyThenAdapt
from adaptctl.files import hashed
from adaptctl.identification import Identification
from adaptctl.identification.columns import JointLog, joint_log
from adaptctl.identification.drives_file import read_drives
from adaptctl.identification.examples import example
from adaptctl.identification.files import write_identification
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.identify import identified
from adaptctl.identification.log_files import read_log
from adaptctl.identification.preparation import filtered, low_pass, prepare
from adaptctl.identification.report import facts, report, verdict
from adaptctl.recording import Comparison
from adaptctl.recording.wording import typeset
from adaptctl.simulation import Rollout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An example identified in one command, which tells the next one."""
    out = tmp_path_factory.mktemp("identified") / "out"
    line = ["identify", "tx40", "--out", str(out), "--friction", "viscous,coulomb,square_root", "--prior-weight", "5"]
    with redirect_stdout(StringIO()) as said:
        assert main(line) == 0
    assert f"adaptctl tune {out / 'robot.toml'}" in said.getvalue()
    return out


def test_the_summary_and_the_validation_agree(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    rows = pq.read_table(folder / "validation.parquet")
    joints = [f"joint_{j}" for j in range(1, 7)]
    assert rows.column_names == ["time", *(f"{what}_{j}" for j in joints for what in ("measured", "predicted"))]
    measured, predicted = (np.stack([rows[f"{what}_{j}"] for j in joints]) for what in ("measured", "predicted"))
    validation = summary["validation"]
    assert validation["rms_error"] == pytest.approx(np.sqrt(np.mean((predicted - measured) ** 2)), rel=1e-12)
    assert validation["relative_error"] == pytest.approx(
        np.linalg.norm(predicted - measured) / np.linalg.norm(measured), rel=1e-12
    )
    each = np.sqrt(np.mean((predicted - measured) ** 2, axis=1))
    assert [validation["joints"][j]["rms_error"] for j in joints] == pytest.approx(each.tolist(), rel=1e-12)
    time = rows["time"].to_numpy()
    assert 3.2 < time[0] < 3.4
    assert time[-1] < 5.4
    assert summary["consistent"] is True
    assert validation["rms_error"] < 1.2
    assert rows.schema.field("measured_joint_1").metadata[b"unit"] == b"N m"


def test_the_robot_is_the_estimate_in_both_formats(folder: Path) -> None:
    estimates = json.loads((folder / "estimates.json").read_text())
    robot = load(folder / "robot.toml")
    np.testing.assert_allclose(
        robot.inertial_parameters, list(estimates["parameters"].values()), rtol=1e-12, atol=1e-15
    )
    assert list(robot.parameter_names) == list(estimates["parameters"])
    numbers = {name: estimates[name] for name in ("fundamental", "parameters")}
    assert estimates["sha256"] == hashed(numbers)
    assert estimates["geometry_sha256"] == robot.geometry_sha256
    assert robot.description.drive_couplings == [[5, [["joint_5", "1.0"]]]]
    again = load(folder / "robot.urdf")
    np.testing.assert_allclose(again.inertial_parameters[:60], robot.inertial_parameters[:60], rtol=1e-9, atol=1e-12)
    for name, entry in estimates["fundamental"].items():
        assert entry["deviation"] > 0.0, name
        assert entry["prior_range"] >= 2.0 * entry["deviation"]
        assert entry["gain"] > 0.0


def test_only_inertials_frictions_and_a_comment_of_the_urdf_are_new(folder: Path) -> None:
    with example("tx40") as files:
        old = files.robot.read_bytes()
    new = (folder / "robot.urdf").read_bytes()
    comment = re.search(rb"\n  <!-- adaptctl identify: URDF has no place for (.*?); robot.toml has all -->", new)
    assert comment is not None
    for joint in load(folder / "robot.toml").primary_joints:
        assert f"{joint.name} rotor inertia {joint.drive.rotor_inertia:.4g}".encode() in comment[1]
    new = new.replace(comment[0], b"")
    inertial, dynamics = (re.compile(rb"<%s>.*?</%s>" % (w, w), re.DOTALL) for w in (b"inertial", b"dynamics"))
    friction = re.compile(rb"\s*<dynamics damping=\S+ friction=\S+/>")
    assert len(friction.findall(new)) == 6
    moving = inertial.split(friction.sub(b"", old))
    assert inertial.split(friction.sub(b"", new)) == moving
    assert not dynamics.search(new)
    assert len(inertial.findall(new)) == len(inertial.findall(old))
    assert inertial.findall(new)[0] == inertial.findall(old)[0]  # of the base, which does not move
    assert inertial.findall(new)[1] != inertial.findall(old)[1]


def test_the_headline_is_of_the_written_file(folder: Path) -> None:
    """Its predictions made by hand: dynamics of the loaded file at the log's motion, through the same filter."""
    summary = json.loads((folder / "summary.json").read_text())
    with example("tx40") as files:
        drives = read_drives(files.drives)
        log = joint_log(read_log(files.log), drives)
    rows = pq.read_table(folder / "validation.parquet")
    time, joints = rows["time"].to_numpy(), [f"joint_{j}" for j in range(1, 7)]
    measured = np.stack([rows[f"measured_{j}"] for j in joints], axis=-1)
    (piece,), _ = prepare(log, load(folder / "robot.toml"))
    smooth = SmoothMotion.of(piece, 0)
    inner = slice(2, -2)
    times = piece.time[smooth.first + smooth.every * np.arange(len(smooth.position))][inner]
    cutoff = summary["validation"]["cutoff"]
    for name in ("robot.toml", "robot.urdf", "robot.xml"):
        torque = load(folder / name).inverse_dynamics(*smooth.states())
        kernel = low_pass(cutoff, smooth.rate)
        slow, half = filtered(torque, kernel), len(kernel) // 2
        found = np.stack([np.interp(time, times[half : half + len(slow)], column) for column in slow.T], axis=-1)
        rms = float(np.sqrt(np.mean((found - measured) ** 2)))
        assert summary["files"][name]["rms_error"] == pytest.approx(rms, rel=1e-2), name
    assert summary["files"]["robot.toml"]["rms_error"] == pytest.approx(summary["validation"]["rms_error"], rel=1e-9)
    assert summary["files"]["robot.toml"]["cannot_hold"] == []
    assert len(summary["files"]["robot.urdf"]["cannot_hold"]) == 6
    assert set(summary["verdict"]) == set(joints)


def slid(v: Array) -> Array:
    """Signs of velocities, as smooth at rest as those of drives."""
    return np.asarray(friction(DriveParameter.COULOMB, v))


def by_pinocchio(path: Path, p: Array, v: Array, a: Array) -> Array:
    """Torques (n, r) of a URDF file, friction included."""
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    inner = np.stack([pinocchio.rnea(model, data, *row) for row in zip(p, v, a, strict=True)])
    return np.asarray(inner + model.damping * v + model.upperDryFrictionLimit * slid(v))


def by_mujoco(path: Path, p: Array, v: Array, a: Array) -> Array:
    """Torques (n, r) of an MJCF file, friction included."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(p, v, a, strict=True):
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.asarray(np.stack(found) + model.dof_frictionloss * slid(v))


@pytest.mark.parametrize(("name", "torques"), [("robot.urdf", by_pinocchio), ("robot.xml", by_mujoco)])
def test_other_readers_predict_as_the_written_file_is_judged(
    folder: Path, name: str, torques: Callable[[Path, Array, Array, Array], Array]
) -> None:
    robot = load(folder / name)
    p, v, a = np.random.default_rng(0).normal(size=(3, 20, robot.dof))
    assert robot.parameter_names[-1].endswith(".coulomb")
    np.testing.assert_allclose(torques(folder / name, p, v, a), robot.inverse_dynamics(p, v, a), rtol=1e-6, atol=1e-6)


def test_the_report_needs_nothing_else_and_the_recording_is_there(folder: Path) -> None:
    page = (folder / "report.html").read_text()
    assert "http" not in re.sub(r"<footer>.*", "", page, flags=re.DOTALL)
    for part in ("link_2.mc_x", "Newton", "block jackknife", "cut-off", "data:image/svg+xml"):
        assert (part in page) is (part != "Newton")
    assert (folder / "recording.rrd").stat().st_size > 10_000
    assert not (folder / "figures").exists()


def slider(*kinds: JointKind) -> Identification:
    """A chain whose joints are of such kinds, with friction, identified from its own motion."""
    given = random_chain(3, len(kinds)).with_drives(Drive(0.3, 2.0, 1.5)).description
    pairs = zip(given.links, kinds, strict=True)
    links = tuple(replace(link, joint=replace(link.joint, kind=kind, limits=Limits())) for link, kind in pairs)
    arm = Mechanism(replace(given, links=links))
    time, p, v, a = motion(len(kinds), np.random.default_rng(1), 8.0, 200.0)
    torque = arm.inverse_dynamics(p, v, a)
    log = JointLog("synthetic", time, p, torque + 1e-3 * np.random.default_rng(2).normal(size=p.shape))
    return identified(arm, joint_drives(arm), [log], [log], friction=FrictionModel(), cutoff=12.5, prior_weight=1.0)


@nightly
def test_figures_are_files_on_demand(tmp_path: Path) -> None:
    found = slider(JointKind.REVOLUTE, JointKind.REVOLUTE)
    write_identification(tmp_path, found, figures=True)
    names = {f"{name}.{kind}" for name in ("torques", "residuals", "excitation") for kind in ("png", "pdf", "svg")}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == names


@pytest.mark.parametrize(
    ("kinds", "unit"),
    [
        ((JointKind.PRISMATIC, JointKind.PRISMATIC), "N"),
        ((JointKind.REVOLUTE, JointKind.REVOLUTE), "N·m"),
        ((JointKind.PRISMATIC, JointKind.REVOLUTE), "N·m or N"),
    ],
)
def test_the_words_on_an_identification_have_its_joints_units(kinds: tuple[JointKind, ...], unit: str) -> None:
    found = slider(*kinds)
    for drawing in report(found).drawings:
        picture = drawing.svg()
        assert ElementTree.fromstring(picture).tag.endswith("svg")
        assert "nan" not in picture
        assert 'height="-' not in picture
    size = " and ".join(f"{x:.3g} {typeset(kind)}" for kind, x in found.validation.rms_errors.items())
    assert {typeset(kind) for kind in found.validation.rms_errors} == set(unit.split(" or "))
    assert f"RMS error of {size} over all joints, " in verdict(found)
    assert next(facts(found)).answer == size
    page = report(found).html({})
    assert not re.search("kg m|N m|N s/m", page)
    for shown in ("kg·m²", "N·m·s"):
        assert (shown in page) is (JointKind.REVOLUTE in kinds)


def test_a_folder_that_is_not_empty_is_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in folder.glob("*.json")}
    assert main(["identify", "tx40", "--out", str(folder)]) == 2
    assert "the folder is not empty" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.glob("*.json")} == before


@pytest.mark.parametrize("name", builtin_names())
@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_mechanisms_are_written_and_read_back(name: str, tmp_path: Path) -> None:
    robot = load(name)
    write_mechanism(tmp_path / f"{name}.toml", robot.description)
    assert load(tmp_path / f"{name}.toml").description == robot.description


def test_drives_are_written_and_read_back(tmp_path: Path) -> None:
    tree = random_chain(1, 3)
    last = Drive(0.1, 1.0, 2.0, -0.5, 0.3, -0.2, turns_with=((tree.links[0].joint.name, -0.5),))
    robot = tree.with_drives([Drive(), Drive(viscous=1.0), last])
    write_mechanism(tmp_path / "robot.toml", robot.description)
    again = load(tmp_path / "robot.toml")
    np.testing.assert_array_equal(again.inertial_parameters, robot.inertial_parameters)
    assert again.links[2].joint.drive == last
    p, v, a = np.random.default_rng(0).normal(size=(3, 5, 3))
    np.testing.assert_allclose(again.inverse_dynamics(p, v, a), robot.inverse_dynamics(p, v, a), rtol=1e-9)


URDF = b"""<?xml version="1.0"?>
<!-- <link name="arm"><inertial/></link> -->
<robot name="a &gt; b">
  <link name="ground"/>
  <link name="arm"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <joint name="turn" type="continuous"><parent link="ground"/><child link="arm"/></joint>
  <link name="tool">
    <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <joint name="held" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 1"/></joint>
</robot>
"""


def test_links_held_fast_keep_theirs_where_bodies_can_have_the_rest(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_bytes(URDF)
    robot = load(tmp_path / "robot.urdf")
    heavy = robot.inertial_parameters + np.array([2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 3.0, 0.0, 0.0, 3.0])
    light = 0.5 * robot.inertial_parameters
    for D, kept in ((heavy, True), (light, False)):
        write_urdf(
            tmp_path / "new.urdf", tmp_path / "robot.urdf", robot.description, robot.description.with_parameters(D)
        )
        np.testing.assert_allclose(load(tmp_path / "new.urdf").inertial_parameters, D, rtol=1e-12, atol=1e-12)
        text = (tmp_path / "new.urdf").read_bytes()
        assert (b'<mass value="1"/>' in text) is kept
        assert text.startswith(URDF[:90])
    assert b'<link name="ground">\n    <inertial>' in with_inertials(URDF, {"ground": heavy})


def test_urdf_that_is_no_text_is_refused_by_its_byte(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_bytes(URDF)
    robot = load(tmp_path / "robot.urdf").description
    data = URDF.replace(b"a &gt; b", b"\xe9")
    (tmp_path / "latin.urdf").write_bytes(data)
    place = rf"latin\.urdf: byte {data.index(0xE9)} is not UTF-8; save the file as UTF-8 text$"
    with pytest.raises(FileError, match=place):
        write_urdf(tmp_path / "new.urdf", tmp_path / "latin.urdf", robot, robot)
    assert not (tmp_path / "new.urdf").exists()


def test_ros_bags_are_read(tmp_path: Path) -> None:
    types = get_typestore(Stores.LATEST)
    state, header, stamp = (
        types.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    names, count = ["shoulder", "elbow"], 50
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=types)
        for i in range(count):
            at = header(stamp=stamp(sec=7, nanosec=10_000_000 * i), frame_id="")
            values = [np.array([float(i), 2.0 * i]), np.array([1.0, 2.0]), np.array([3.0, float(i)])]
            message = state(header=at, name=names, position=values[0], velocity=values[1], effort=values[2])
            writer.write(connection, 10_000_000 * i, types.serialize_cdr(message, state.__msgtype__))
    for place in (tmp_path / "bag", next((tmp_path / "bag").glob("*.mcap"))):
        log = read_log(place)
        assert len(log) == count
        np.testing.assert_allclose(log.column("time", "time"), 0.01 * np.arange(count), atol=1e-12)
        np.testing.assert_array_equal(log.column("position.elbow", "position"), 2.0 * np.arange(count))
        np.testing.assert_array_equal(log.column("effort.elbow", "torque"), np.arange(count))
        assert log.units["effort.elbow"] == "N m"
    with pytest.raises(FileError, match="no joint-state topic /nothing; topics: /joint_states"):
        read_log(tmp_path / "bag", "/nothing")
    with Writer(tmp_path / "two", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, count in (("/right", 3), ("/left", 2)):
            connection = writer.add_connection(topic, state.__msgtype__, typestore=types)
            for i in range(count):
                writer.write(connection, 10_000_000 * i, types.serialize_cdr(message, state.__msgtype__))
    with pytest.raises(FileError, match="several joint-state topics: /left, /right; select one with --topic"):
        read_log(tmp_path / "two")
    assert [len(read_log(tmp_path / "two", topic)) for topic in ("/left", "/right")] == [2, 3]
    (tmp_path / "bad.mcap").write_bytes(b"nonsense")
    with pytest.raises(FileError, match=r"bad\.mcap: cannot be read as MCAP \(not a valid MCAP file"):
        read_log(tmp_path / "bad.mcap")


def test_runs_are_kept_and_read_back_and_identified(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arrays = {name: rng.normal(size=(40, 2)) for name in ("p", "v", "reference_p", "reference_v", "reference_a")}
    arrays |= {name: rng.normal(size=(40, 2)) for name in ("torque", "applied", "measured_p", "measured_v")}
    single = {name: rng.normal(size=40) for name in ("clipped", "energy", "reward")}
    single["energy"][3] = np.nan
    run = Rollout(
        time=np.arange(40) * 0.01,
        **arrays,
        **single,
        estimate=rng.normal(size=(40, 3)),
        control_period=0.01,
        wall_time=0.5,
        terminated=True,
        flags={"payload": rng.normal(size=40)},
    )
    run.save(tmp_path / "run.parquet", ["shoulder", "elbow"])
    again = Rollout.load(tmp_path / "run.parquet")
    for name in (*arrays, *single, "time", "estimate"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
        assert not getattr(again, name).flags.writeable
    np.testing.assert_array_equal(again.flags["payload"], run.flags["payload"])
    assert (again.control_period, again.wall_time, again.interrupted, again.terminated) == (0.01, 0.5, False, True)
    log = read_log(tmp_path / "run.parquet")
    np.testing.assert_array_equal(log.column("applied.elbow", "torque"), run.applied[:, 1])
    assert (log.units["p.elbow"], log.units["applied.elbow"], log.units["time"]) == ("rad", "N m", "s")
    for content, message in ((b"no", "cannot be read as Parquet"), (None, "not a run of adaptctl")):
        if content is None:
            with example("tx40") as files:
                content = files.log.read_bytes()
        (tmp_path / "bad.parquet").write_bytes(content)
        with pytest.raises(FileError, match=message):
            Rollout.load(tmp_path / "bad.parquet")


@nightly
def test_an_identified_estimate_starts_three_times_closer_than_none() -> None:
    result = IdentifyThenAdapt(duration=2.5).compare(lambda what, share: None)
    assert isinstance(result, Comparison)
    found = {finding.name: finding.value for finding in result.findings}
    assert found["zero_over_identified"] > 3.0
    assert found["first_error.adaptive"] < 2.5e-3
    assert found["first_error.adaptive"] < 0.5 * found["first_error.from-urdf"]
    assert found["first_error.adaptive"] < 0.5 * found["first_error.adaptation-off"]
