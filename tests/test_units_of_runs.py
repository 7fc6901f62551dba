"""Units of runs whose joints slide: of their arrays, in tables and files, and back from there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.control import ComputedTorque
from adaptctl.dynamics import Mechanism
from adaptctl.envs import TrackingEnv
from adaptctl.errors import FileError, InputError
from adaptctl.identification.columns import joint_columns
from adaptctl.identification.drives_file import Drives, read_drives
from adaptctl.identification.log_files import read_log, table
from adaptctl.identification.unknown_columns import validate_drives
from adaptctl.logs.table import LogTable
from adaptctl.simulation import Rollout, RunLogger, rollout, simulate

UNITS = ("m", "rad")


def slide_and_turn() -> Mechanism:
    """An arm of a joint that slides and one that turns."""
    arms = (random_chain(seed, 2) for seed in range(99))
    return next(arm for arm in arms if [joint.kind.is_revolute for joint in arm.primary_joints] == [False, True])


def run(make: Any, **more: Any) -> Rollout:
    arm = slide_and_turn()
    env = TrackingEnv(arm, 1, duration=0.2, error_bound=10.0, torque_limits=1e4)
    return make(env, ComputedTorque(arm, 5.0), seed=0, **more)


def units(schema: Any) -> dict[str, str]:
    return {field.name: field.metadata[b"unit"].decode() for field in schema}


def test_each_joint_has_its_own_units(tmp_path: Path) -> None:
    for make in (rollout, simulate):
        found = units(run(make).to_arrow(["rail", "elbow"]).schema)
        assert (found["p.rail"], found["p.elbow"]) == ("m", "rad")
        assert (found["reference_v.rail"], found["v.elbow"]) == ("m/s", "rad/s")
        assert (found["reference_a.rail"], found["reference_a.elbow"]) == ("m/s^2", "rad/s^2")
        assert (found["torque.rail"], found["applied.elbow"]) == ("N", "N m")
    run(simulate, stream=tmp_path / "stream.parquet")
    run(simulate, keep_last=0.1).save(tmp_path / "saved.parquet")
    for name in ("stream", "saved"):
        again = Rollout.load(tmp_path / f"{name}.parquet")
        assert again.position_units == UNITS
        assert units(again.to_arrow().schema)["applied.joint1"] == "N"


def test_runs_of_ones_own_say_their_units(tmp_path: Path) -> None:
    p = np.sin(np.arange(20.0))[:, None] * [1.0, 2.0]
    own = Rollout.from_arrays(p, p, p, 1e-3, position_units=UNITS)
    assert units(own.to_arrow().schema)["reference_p.joint1"] == "m"
    assert units(Rollout.from_arrays(p, p, p, 1e-3).to_arrow().schema)["reference_p.joint1"] == "rad"
    log = RunLogger(2, 1e-3, position_units=UNITS)
    assert log._units == UNITS
    for wrong in (("m",), ("m", "mm"), "mm", (None, "m")):
        with pytest.raises(InputError, match="position_units: expected 2 of rad and m, got"):
            Rollout.from_arrays(p, p, p, 1e-3, position_units=wrong)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="position_units: expected 2 of rad and m, got"):
            RunLogger(2, 1e-3, position_units=wrong)  # type: ignore[arg-type]


def test_a_file_with_units_of_other_joints_is_refused(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    run(simulate).save(tmp_path / "run.parquet")
    with pq.ParquetFile(tmp_path / "run.parquet") as file:
        read, about = file.read(), {**file.metadata.metadata, b"position_units": b'["m"]'}
    pq.write_table(read.replace_schema_metadata(about), tmp_path / "x")
    with pytest.raises(FileError, match=r"x: .*position_units: expected 2 of rad and m, got 1"):
        Rollout.load(tmp_path / "x", accept_edited=True)


def test_identify_reads_columns_of_joints_of_both_kinds(tmp_path: Path) -> None:
    """Radians and metres, newton metres and newtons: each is an SI unit, stated by the file."""
    arm = slide_and_turn()
    names = [joint.name for joint in arm.primary_joints]
    run(simulate).save(tmp_path / "run.parquet", names)
    drives = joint_columns(arm, read_log(tmp_path / "run.parquet"))
    assert (drives.units.position, drives.units.torque, drives.units.velocity) == (1.0, 1.0, 1.0)


def test_columns_in_units_of_different_factors_are_told_apart() -> None:
    arm = slide_and_turn()
    columns = {f"{what}.{joint.name}": np.arange(9.0) for joint in arm.primary_joints for what in ("p", "applied")}
    said = dict.fromkeys(columns, "N") | {"time": "s", "p.joint0": "mm", "p.joint1": "rad"}
    log = table("log.csv", {"time": np.arange(9.0), **columns}.items(), said)
    with pytest.raises(
        InputError,
        match=r"log\.csv: the columns of position have different units \(mm, rad\); convert them to SI units",
    ):
        joint_columns(arm, log)


def short_log() -> LogTable:
    """Numbers of an arm of both kinds of joints, without units."""
    joints = [joint.name for joint in slide_and_turn().primary_joints]
    columns = {f"{what}.{joint}": np.arange(9.0) for joint in joints for what in ("p", "applied", "v")}
    return table("log.csv", {"time": np.arange(9.0), **columns}.items())


OF_EACH = {"time": "s", "position": "mm, deg", "velocity": "mm/s,rpm", "torque": "N,Nm"}


def test_each_joint_may_have_a_unit_of_its_own() -> None:
    drives = joint_columns(slide_and_turn(), short_log(), units=OF_EACH)
    assert drives.position_factors.tolist() == [1e-3, np.pi / 180]
    assert drives.velocity_factors.tolist() == [1e-3, np.pi / 30]


@pytest.mark.parametrize(
    ("position", "words"),
    [
        ("deg,mm", "slides: expected m or mm, got 'deg'"),
        ("rad,deg", "slides: expected m or mm, got 'rad'"),
        ("mm,rad,rad", "one for each of 2 joints"),
        ("mm,grad", "position: expected one of .* got 'grad'"),
        ("deg", "or one for each: --units position=mm,deg$"),
    ],
)
def test_wrong_units_of_joints_are_told(position: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        joint_columns(slide_and_turn(), short_log(), units=OF_EACH | {"position": position})


def drives_file(folder: Path, ratio: float = 1.0, unit: str = "deg", own: str = "") -> Drives:
    joints = [joint.name for joint in slide_and_turn().primary_joints]
    motors = [f'{{ position = "p.{j}", torque = "applied.{j}"{own * (j == joints[0])} }}' for j in joints]
    lines = [
        'schema = "adaptctl/drives/1"',
        f"joints = {joints}",
        f"transmission = [[{ratio}, 0], [0, 1]]",
        f'units = {{ time = "s", position = "{unit}", torque = "N m" }}',
        f"motors = [{', '.join(motors)}]",
    ]
    (folder / "drives.toml").write_text("\n".join(lines))
    return read_drives(folder / "drives.toml")


def test_a_motor_may_have_a_unit_of_its_own(tmp_path: Path) -> None:
    drives = drives_file(tmp_path, own=', position_unit = "mm"')
    assert drives.position_factors.tolist() == [1e-3, np.pi / 180]
    validate_drives(short_log(), drives, slide_and_turn())
    validate_drives(short_log(), drives_file(tmp_path, ratio=1200.0), slide_and_turn())  # a spindle
    with pytest.raises(FileError, match=r"motors\[0\].position_unit: .*got 'grad'"):
        drives_file(tmp_path, own=', position_unit = "grad"')


@pytest.mark.parametrize(("unit", "words"), [("deg", "slides: .*'deg'.*position_unit"), ("mm", "turns: .*'mm'")])
def test_units_of_a_file_fit_the_joints(tmp_path: Path, unit: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        validate_drives(short_log(), drives_file(tmp_path, unit=unit), slide_and_turn())
