"""Files that cannot hurt: every bad file is refused at once, in one line, with file and element."""

from __future__ import annotations

import json
import re
import time
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import msgspec
import numpy as np
import pytest
from bad_files import CHAIN, CONSTRAINTS, GOOD, PRIORITY, URDF, bad_bases, bad_files, pipe
from fuzzing import Outcome, fuzz
from nightly import at_night

from adaptctl.cli.main import main
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError, FileError, InputError, SimplificationWarning, printable
from adaptctl.identifiability import (
    Constraints,
    FundamentalBasis,
    Priority,
    ReducedModel,
    constrained,
    essential_space,
    fundamental_basis,
)
from adaptctl.identification.log_files import read_log
from adaptctl.recording.finished_trace import read_trace
from adaptctl.simulation import Plant, Rollout
from adaptctl.simulation.mujoco_plant import MuJoCoPlant
from adaptctl.sweeps.folder import read_checked

pytestmark = pytest.mark.filterwarnings(
    "ignore::adaptctl.errors.SimplificationWarning", "ignore::adaptctl.errors.PhysicalConsistencyWarning"
)

FILES = bad_files()
LONGEST = 2.0
"""s of processor time for a refusal"""


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    path = tmp_path_factory.mktemp("chain") / "two.toml"
    path.write_text(CHAIN)
    return load(path)


def reader_of(name: str, chain: Mechanism) -> Callable[[Path], object]:
    if name.endswith(".constraints.toml"):
        return lambda path: constrained(chain, Constraints.read(path))
    if name.endswith(".priority.toml"):
        return lambda path: Priority.read(path, chain)
    return load


def test_the_corpus_is_large() -> None:
    assert len(FILES) >= 300


@pytest.mark.parametrize("kind", GOOD)
def test_what_the_corpus_is_made_of_is_good(kind: str, tmp_path: Path) -> None:
    (tmp_path / f"good{kind}").write_text(GOOD[kind])
    assert np.isfinite(load(tmp_path / f"good{kind}").inertial_parameters).all()


def test_other_files_are_good_too(chain: Mechanism, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(CONSTRAINTS)
    (tmp_path / "p.toml").write_text(PRIORITY)
    assert constrained(chain, Constraints.read(tmp_path / "c.toml")).parameter_names
    assert Priority.read(tmp_path / "p.toml", chain).keep == ("link2.I_zz",)


@pytest.mark.parametrize("name", FILES)
def test_bad_files_are_refused_at_once(name: str, chain: Mechanism, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    read, start = reader_of(name, chain), time.process_time()
    with pytest.raises(InputError) as refusal:
        read(path)
    assert time.process_time() - start < LONGEST
    message = str(refusal.value)
    names_file = name in message or name.endswith((".constraints.toml", ".priority.toml"))
    assert names_file
    assert len(message) < 2100 + len(str(path))
    assert all(c.isprintable() or c == "\n" for c in message)


XML_WITH_LINES = [
    name for name in FILES if re.search(r"^(mass|axis|size|capsule|density|no-such).*\.(urdf|xml)$", name)
]


@pytest.mark.parametrize("name", XML_WITH_LINES)
def test_the_line_is_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(FILES[name])
    with pytest.raises(FileError, match=r"(line \d+)"):
        load(path)


@pytest.fixture(scope="module")
def basis(chain: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("basis") / "good.json"
    fundamental_basis(essential_space(chain)).save(path)
    return path.read_text()


BASES = (
    *("scales-zero", "scales-negative", "scales-short", "gap-zero", "gap-negative", "rank", "schema", "coefficient"),
    *("term-missing", "row-missing", "lone-row-missing", "no-such-parameter", "parameters-twice", "parameters-5000"),
    *("nan", "key-twice", "cut", "deep"),
)


@pytest.mark.parametrize("name", BASES)
def test_bad_bases_are_refused(name: str, basis: str, chain: Mechanism, tmp_path: Path) -> None:
    """A wrong coefficient or a missing row shows against the mechanism's own energies."""
    found = bad_bases(basis)
    assert set(found) == set(BASES)
    (tmp_path / "basis.json").write_text(found[name])
    with pytest.raises(AdaptctlError) as refused:
        FundamentalBasis.load(tmp_path / "basis.json")
    if "the basis was changed" in str(refused.value):
        accepting = str(refused.value).split('"')[-2]
        (tmp_path / "basis.json").write_text(json.dumps({**json.loads(found[name]), "sha256": accepting}))
        with pytest.raises(InputError):
            ReducedModel(chain, FundamentalBasis.load(tmp_path / "basis.json"))


def test_a_good_basis_comes_back(basis: str, chain: Mechanism, tmp_path: Path) -> None:
    (tmp_path / "basis.json").write_text(basis)
    assert ReducedModel(chain, FundamentalBasis.load(tmp_path / "basis.json")).names


def test_pipes_and_devices_are_refused(tmp_path: Path) -> None:
    for name in ("pipe.urdf", "pipe.xml", "pipe.toml"):
        with pipe(tmp_path / name), pytest.raises(FileError, match="not a regular file"):
            load(tmp_path / name)
    (tmp_path / "zero.urdf").symlink_to("/dev/zero")
    with pytest.raises(FileError, match="not a regular file"):
        load(tmp_path / "zero.urdf")


@pytest.mark.parametrize(
    ("read", "name"),
    [(read_log, "log.csv"), (read_log, "log.parquet"), (read_log, "log.mcap"), (Rollout.load, "run.parquet")],
)
def test_pipes_are_no_logs_and_runs(read: Callable[[Path], object], name: str, tmp_path: Path) -> None:
    """Who opened one would wait for somebody to write into it."""
    told = f"{name}: cannot be read .not a regular file"
    with pipe(tmp_path / name), pytest.raises(FileError, match=told):
        read(tmp_path / name)


def test_pipes_are_no_scenes(tmp_path: Path) -> None:
    with pipe(tmp_path / "scene.xml"), pytest.raises(FileError, match="not a regular file"):
        MuJoCoPlant.of(tmp_path / "scene.xml", 1e-3)


def test_pipes_are_no_traces_and_rows(tmp_path: Path) -> None:
    for read in (read_trace, lambda folder: read_checked(folder / "trace.parquet")):
        with pipe(tmp_path / "trace.parquet"), pytest.raises(FileError, match="not a regular file"):
            read(tmp_path)
        (tmp_path / "trace.parquet").unlink()


def test_what_files_say_is_known_or_refused() -> None:
    """In every table of a format of our own; others' formats, and a run's summary, may say more."""
    places = [path for path in Path("adaptctl").rglob("*.py") if "(msgspec.Struct" in path.read_text()]
    modules = [import_module(".".join(path.with_suffix("").parts)) for path in places]
    tables = {one for module in modules for one in vars(module).values() if isinstance(one, type(msgspec.Struct))}
    assert len(tables) > 25
    lenient = {one.__module__.rpartition(".")[2] for one in tables if not one.__struct_config__.forbid_unknown_fields}
    assert lenient == {"registry", "foxglove", "run_table"}


def test_a_basis_file_beyond_its_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "basis.json").write_text(" " * (8 * 2**20 + 1))
    with pytest.raises(FileError, match="larger than 8388608 bytes"):
        FundamentalBasis.load(tmp_path / "basis.json")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (URDF.replace('lower="-2" upper="2"', 'lower="-90" upper="170"'), "limits of first; 170 degrees are 2.967"),
        (URDF.replace('rpy="0 0 0"', 'rpy="0 90 0"'), "rpy of joint 'first'"),
        (CHAIN.replace("alpha = 1.5", "alpha = 90.0"), "alpha or theta of link1"),
        (CHAIN.replace("velocity = 3.0", "range = [-170.0, 170.0]"), "limits of joint1"),
    ],
)
def test_degrees_where_radians_are_meant_are_warned_of(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / ("a.urdf" if text.startswith("<") else "a.toml")
    path.write_text(text)
    with pytest.warns(SimplificationWarning, match=f"look like degrees: {what}"):
        load(path)


def test_a_link_without_mass_that_carries_none_is_warned_of_and_cannot_be_simulated(tmp_path: Path) -> None:
    """Its dynamics say nothing of how it accelerates; its kinematics, and what its base needs, are as good as ever."""
    inertial = URDF[URDF.rindex("<inertial>") : URDF.rindex("</inertial>") + len("</inertial>")]
    (tmp_path / "a.urdf").write_text(URDF.replace(inertial, ""))
    with pytest.warns(SimplificationWarning, match="moving links without mass .*: tool"):
        arm = load(tmp_path / "a.urdf")
    assert np.isfinite(arm.inverse_dynamics([0.1, 0.1], [1.0, 1.0], [1.0, 1.0])).all()
    for samples in ((), (3,)):
        with pytest.raises(InputError, match="tool"):
            arm.forward_dynamics(np.zeros((*samples, 2)), np.zeros(2), np.ones(2))
    with pytest.raises(InputError, match="tool"):
        Plant(arm, 1e-3)


def test_names_set_no_terminals_title(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.toml").write_text(CHAIN.replace('"two"', '"\\u001b]0;title\\u0007"'))
    assert main(["basis", str(tmp_path / "a.toml")]) == 2
    assert main(["basis", "\x1b]0;title\x07"]) == 2
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert "\\x1b" in said.err


def test_what_is_printed_is_printable_and_short() -> None:
    assert printable("a\x1b[2Jb") == "a\\x1b[2Jb"
    assert printable("\u202e") == "\\u202e"
    assert printable("joint_θ") == "joint_θ"
    assert printable("x" * 1000) == "x" * 39 + "..." + "x" * 38
    assert [printable("abcdef", most) for most in (0, 1, 5, 6)] == ["", ".", "a...f", "abcdef"]
    assert printable("a" + "\x1b" * 1000 + "b", 9) == "a\\x...1bb"
    for text in ("x" * 10**6, "\x1b" * 5000, "\x1b" * 1999):
        assert len(str(AdaptctlError(text))) == 2000
    assert str(AdaptctlError(AdaptctlError("x" * 3000))) == str(AdaptctlError("x" * 3000))


@pytest.mark.parametrize("count", [500, at_night(4000)])
def test_mutants_do_no_harm(count: int, tmp_path: Path) -> None:
    """Read, and then finite and physical to look at; or refused. See `fuzzing`, which makes as many as one likes."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        report = fuzz(count, seed=0, folder=tmp_path)
    assert report.failures == []
    assert report.counts[Outcome.REFUSED] > count / 4
    assert report.counts[Outcome.READ] > count / 20
