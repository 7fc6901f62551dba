"""A contest of laws: entries, reasons of failures, seeds, ranks and the command."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from contest_rows import ARM, entry, reasons, written
from followed_page import blocks, commands

from adaptctl.cli.main import main
from adaptctl.contest import report, running
from adaptctl.contest.contest_file import Contest
from adaptctl.contest.entries import ContestEntry
from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import LAWS
from adaptctl.contest.running import ContestFolder
from adaptctl.contest.scene import Scene, scene_of
from adaptctl.contest.trial import TimeExceededError, tried
from adaptctl.errors import FileError, InputError, MissingExtraError, NotFoundError

OWN = '''
import time
from dataclasses import dataclass
from adaptctl.control import Controller, Gradient
from adaptctl.control.adaptation.law import NoMemory
from adaptctl.scalars import Column

@dataclass(frozen=True, eq=False)
class Slower(Gradient):
    """Gradient at half its rate."""
    def law(self, model, estimate, period, memory):
        moved, memory = super().law(model, estimate, period, memory)
        return estimate + 0.5 * (moved - estimate), memory

@dataclass(frozen=True, eq=False)
class Own(Controller):
    mechanism: object
    damping: object
    @property
    def dof(self):
        return self.mechanism.dof
    def initial_state(self, p, v):
        return NoMemory()

@dataclass(frozen=True, eq=False)
class Tuned(Own):
    stiffness: float = 1.0
    @classmethod
    def enter(cls, known):
        return cls(known.mechanism, known.damping, 2.0 * known.stiffness)
    def law(self, p, v, reference, memory):
        error, rate = p - reference.p, v - reference.v
        terms = zip(self.stiffness.tolist(), error, self.damping.tolist(), rate)
        return Column(-k * e - d * r for k, e, d, r in terms), memory

class Raises(Own):
    def law(self, p, v, reference, memory):
        raise KeyError("oops")

class Listed(Own):
    def law(self, p, v, reference, memory):
        return [-x for x in p], memory

class NotANumber(Own):
    def law(self, p, v, reference, memory):
        return Column(x * float("nan") for x in p), memory

class Unstable(Own):
    def law(self, p, v, reference, memory):
        return 1e3 * p, memory

class Reads(Own):
    def law(self, p, v, reference, memory):
        return Column(self.mechanism.inertial_parameters[0] * x for x in p), memory

class ReadsFile(Reads):
    knows = "file"

class Endless(Own):
    def law(self, p, v, reference, memory):
        while True:
            pass

@dataclass(frozen=True, eq=False)
class Asks(Own):
    true_mass: float
    def law(self, p, v, reference, memory):
        return p, memory

@dataclass(frozen=True, eq=False)
class AsksParameters(Own):
    parameters: object
    def law(self, p, v, reference, memory):
        return p, memory

class Oracle(Own):
    knows = "truth"

class gradient(Slower):
    pass
'''


@pytest.fixture
def own(tmp_path: Path) -> str:
    (tmp_path / "own.py").write_text(OWN)
    return str(tmp_path / "own.py")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of(ARM, 1e-3)


@pytest.mark.parametrize(
    ("law", "reason"),
    [
        ("Raises", "KeyError: 'oops' (line 38)"),
        ("Listed", "Listed.law: expected it to return the torque, a Column of 2, and the next state, got list"),
        ("NotANumber", "torque is not a number from 0.00 s on"),
        ("Unstable", "error beyond 2 rad at"),
        ("Reads", "needs the parameters of the arm's links, which a law that knows limits may not have"),
        ("Asks", "needs true_mass, which a law may not know"),
        ("AsksParameters", "needs parameters, which a law that knows limits may not have"),
        ("Oracle", "knows: expected one of 'limits', 'wrong file', 'file', got 'truth'"),
        ("Missing", "no class 'Missing'"),
    ],
)
def test_a_law_that_fails_is_a_row_with_its_reason(own: str, law: str, reason: str) -> None:
    rows = entry(f"{own}:{law}").rows()
    assert [(row["seed"], row["law"]) for row in rows] == [(1, law), (2, law)]
    assert all(reason in told for told in reasons(rows))
    assert all(np.isnan(row["error"]) for row in rows)


def test_a_copy_of_a_law_elsewhere_is_a_law_of_its_own(own: str, tmp_path: Path) -> None:
    (tmp_path / "copied").mkdir()
    copy = tmp_path / "copied" / "own.py"
    copy.write_text(OWN)
    for path in (own, copy):
        (told,) = reasons(entry(f"{path}:Raises", seeds=(1,)).rows())
        assert told.endswith("(line 38)")


def test_a_law_that_never_ends_is_stopped(own: str, scene: Scene) -> None:
    from adaptctl.contest.own_law import own_entrant

    endless = own_entrant(f"{own}:Endless")
    with pytest.raises(TimeExceededError, match="too slow"):
        tried(endless, Known.of(scene, endless.knows, 1, scene.mechanism.inertial_parameters), 0.3)


def test_a_law_that_says_that_it_knows_the_file_may_use_it(own: str, scene: Scene) -> None:
    from adaptctl.contest.own_law import own_entrant

    reads = own_entrant(f"{own}:ReadsFile")
    assert reads.knows is Knowledge.FILE
    assert tried(reads, Known.of(scene, reads.knows, 1, scene.mechanism.inertial_parameters)) > 0


def test_a_law_may_bring_gains_of_its_own_and_the_tables_say_so(own: str) -> None:
    rows = entry(f"{own}:Tuned").rows()
    assert reasons(rows) == {""}
    assert {row["gains"] for row in rows} == {"by its own gains"}
    assert {row["gains"] for row in entry("pd").rows()} == {"by the rule"}


def test_all_laws_of_the_library_are_made_and_know_no_more_than_they_say(scene: Scene) -> None:
    truth = 1.1 * scene.mechanism.inertial_parameters
    found = {law.name: tried(law, Known.of(scene, law.knows, 1, truth)) for law in LAWS}
    assert len(found) == len(LAWS) >= 15
    assert found["pd"] < found["gradient"] < found["learning"]


def test_rows_do_not_depend_on_other_seeds_and_say_what_a_seed_drew(scene: Scene) -> None:
    both, alone = (entry("gradient", "noise", "links-wrong", seeds=seeds).rows() for seeds in ((1, 2), (2,)))
    second = [row for row in both if row["seed"] == 2]
    for one, other in zip(second, alone, strict=True):
        assert one["error"] == pytest.approx(other["error"], rel=1e-9)
    assert both[0]["error"] != both[1]["error"]
    assert set(np.abs(scene.initial_error(1))) == set(scene.tuning.initial_error)
    later = scene.reference(1), scene.reference(1)
    np.testing.assert_array_equal(later[0](3.0).p, later[1](3.0).p)
    assert not np.allclose(later[0](3.0).p, scene.reference(2)(3.0).p)


@pytest.mark.parametrize(
    ("changed", "kind", "message"),
    [
        ({"laws": ["mine.py"]}, NotFoundError, "law 'mine.py' (its class is missing: FILE.py:CLASS); laws: true"),
        ({"conditions": ["mine.py"]}, NotFoundError, "unknown condition 'mine.py'; conditions: clean, "),
        ({"laws": ["gradiant"]}, NotFoundError, "unknown law 'gradiant' (did you mean 'gradient'?); laws: true, "),
        ({"conditions": ["windy"]}, NotFoundError, "unknown condition 'windy'; conditions: clean, "),
        ({"laws": ["own.py:gradient", "gradient"]}, InputError, "two are called 'gradient'"),
        ({"laws": ["own.py:gradient"]}, InputError, "two are called 'gradient', the library's and"),
        ({"laws": ["gone.py:A"]}, FileError, "gone.py: no such file"),
        ({"robots": []}, InputError, "robots: expected at least one"),
        ({"seeds": [1, 1]}, InputError, "seeds: 1 is given twice"),
        ({"seeds": [-1]}, InputError, "seeds"),
        ({"duration": 0.0}, InputError, "duration: expected 0.1 to 1000 s"),
        ({"robots": ["{no-such-package}/a.urdf"]}, Exception, "no-such-package is not installed"),
        ({"plant": "mujoco", "conditions": ["noise"]}, InputError, "the plant mujoco has no noise; it has clean"),
        ({"plant": "drake", "conditions": ["friction"]}, InputError, "the plant drake has no friction; it has clean"),
        ({"plant": "drake"}, MissingExtraError, "the plant drake needs pydrake: pip install drake"),
        ({"robots": ["gone.urdf"]}, FileError, "gone.urdf: cannot be read"),
        ({"robots": ["puma56"]}, NotFoundError, "unknown robot 'puma56' (did you mean 'puma560'?)"),
        ({"arms": ["puma560"]}, FileError, "unknown field `arms`"),
        ({"families.twins": ["two_lynk"]}, NotFoundError, "unknown robot 'two_lynk' (did you mean 'two_link'?)"),
        ({"families.a": [ARM], "families.b": [ARM]}, InputError, "'two_link' is in two; a robot is of one family"),
    ],
)
def test_a_contest_that_cannot_be_is_refused(
    own: str, tmp_path: Path, changed: dict[str, Any], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind) as error:
        Contest.of(written(tmp_path, **changed))
    assert message in str(error.value)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
def test_laws_are_not_judged_on_what_they_were_tuned_on(tmp_path: Path) -> None:
    (tmp_path / "earlier").mkdir()
    written(tmp_path / "earlier", seeds=[2, 3])
    with pytest.raises(InputError, match="has two_link, seed 2 too"):
        Contest.of(written(tmp_path, tuned_on="earlier/contest.toml"))
    for name in ("laws_judged_on", "contest"):
        Contest.of(Path(f"benchmarks/{name}.toml"))


def test_the_hash_is_of_what_is_judged_on_alone(tmp_path: Path) -> None:
    first = Contest.of(written(tmp_path)).scoring_hash
    assert Contest.of(written(tmp_path, laws=["true"], purpose="Other.")).scoring_hash == first
    assert Contest.of(written(tmp_path, seeds=[1, 3])).scoring_hash != first


class InThisProcess:
    """Workers of a contest, without processes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, drawn: bool = False) -> None:
        self.computed: list[str] = []
        monkeypatch.setattr(running, "computed", self._computed)
        if not drawn:
            monkeypatch.setattr(report, "write_paper", lambda *_: None)  # which takes seconds
        monkeypatch.setattr("adaptctl.sweeps.cluster.Cluster.client", lambda cluster: self)

    def _computed(self, client: Any, missing: dict[str, ContestEntry]) -> Iterator[tuple[ContestEntry, Any]]:
        for each in list(missing.values()):
            self.computed.append(each.law)
            del missing[f"contest-{each.name}"]
            yield each, each.rows()

    def __enter__(self) -> InThisProcess:
        return self

    def __exit__(self, *_: object) -> None:
        return


def test_the_command_writes_all_files_resumes_and_runs_a_new_law_alone(
    own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    workers, out = InThisProcess(monkeypatch), tmp_path / "out"
    assert main(["contest", str(written(tmp_path)), "--out", str(out)]) == 0
    before = pq.read_table(out / "results.parquet")
    assert main(["contest", str(written(tmp_path, laws=["true", "gradient", "own.py:Slower"])), "--out", str(out)]) == 0
    assert [Path(law).name for law in workers.computed] == ["true", "gradient", "own.py:Slower"]
    after = pq.read_table(out / "results.parquet")
    assert after.filter(np.array(after["law"]) != "Slower").equals(before)
    assert {f.metadata[b"unit"] for f in after.schema if f.name.startswith("error")} == {b"mrad (mm)"}
    told = capsys.readouterr().out
    assert "Slower" in told
    assert re.search(r"^Critical difference of ranks: \d", told, re.M)
    assert ("Halves of the seeds: " in told) == (len(set(after["seed"].to_pylist())) > 1)
    assert after.schema.metadata[b"scoring"].decode() in told
    assert all(Path(path).exists() for path in re.findall(r"^(?:Rows|Page): +(.+)$", told, re.M))
    assert {"index.html", "ranks.parquet"} <= {path.name for path in out.iterdir()}
    assert json.loads((out / "contest.json").read_text())["sha256"] == after.schema.metadata[b"scoring"].decode()
    shard = next((out / "shards").glob("*.true.*"))
    shard.write_bytes(shard.read_bytes()[:-9])  # as by a full disk
    assert main(["contest", str(written(tmp_path)), "--out", str(out)]) == 0
    assert workers.computed[3:] == ["true"]


def test_laws_of_others_run_first_and_one_that_fails_is_told_at_once(
    own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    workers = InThisProcess(monkeypatch)
    path = written(tmp_path, laws=["true", "own.py:Raises"])
    assert main(["contest", str(path), "--out", str(tmp_path / "out")]) == 0
    assert [Path(law).name for law in workers.computed] == ["own.py:Raises", "true"]
    assert "note: Raises fails on two_link: KeyError: 'oops'" in capsys.readouterr().err


def test_rows_are_kept_only_for_the_robot_and_the_law_that_made_them(own: str, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    robot.write_text(Path("adaptctl/description/robots/two_link.toml").read_text())
    path = written(tmp_path, robots=["arm.toml"], laws=["own.py:Slower"])

    def names() -> list[str]:
        return [each.name for each in ContestFolder(tmp_path, Contest.of(path)).entries()]

    found = [names(), names()]
    robot.write_text(robot.read_text().replace("mass = 2.0", "mass = 2.1"))
    found.append(names())
    Path(own).write_text(OWN.replace("0.5 *", "0.6 *"))
    found.append(names())
    assert found[0] == found[1]
    assert len({name for each in found for name in each}) == 3


def test_one_run_is_repeated_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    InThisProcess(monkeypatch)
    one = ["--law", "gradient", "--robot", "two_link", "--condition", "clean", "--seed", "2"]
    for more, folder in (([], "all"), (one, "one")):
        assert main(["contest", str(written(tmp_path)), "--out", str(tmp_path / folder), *more]) == 0
    whole, alone = (pq.read_table(tmp_path / folder / "results.parquet").to_pylist() for folder in ("all", "one"))
    assert len(alone) == 1
    assert alone[0]["error"] == pytest.approx(whole[3]["error"], rel=1e-9)
    assert main(["contest", str(written(tmp_path)), "--out", str(tmp_path / "no"), "--law", "pd"]) == 2


@pytest.mark.nightly
def test_laws_are_timed_one_by_one_and_kept_while_they_are_as_they_were(own: str, tmp_path: Path) -> None:
    laws, out = ["true", "own.py:Ends", "own.py:Slower", "own.py:Raises"], tmp_path / "out"
    (tmp_path / "own.py").write_text(OWN + "class Ends(Own):\n    def law(self, *_):\n        raise SystemExit(3)\n")
    asked = ["contest", str(written(tmp_path, laws=laws)), "--out", str(out), "--jobs", "1", "--measure-step-time"]
    assert main(asked) == 0
    rows = pq.read_table(out / "times.parquet").to_pylist()
    assert {row["law"]: row["step"] is None for row in rows} == {
        "true": False, "Ends": True, "Slower": False, "Raises": True
    }  # fmt: skip
    assert main(asked) == 0
    assert pq.read_table(out / "times.parquet").to_pylist() == rows
    assert "step, µs" in (out / "index.html").read_text()


def lesson(folder: Path) -> tuple[str, list[list[str]]]:
    """Write the files of the lesson; its text and its commands."""
    page = Path("docs/tutorials/enter-the-contest.md").read_text()
    for block in blocks(page):
        if block.file and block.kind != "console":
            (folder / block.file).write_text(block.text)
    return page, [words for block in blocks(page) if block.kind == "console" for words in commands(block.text)]


def test_the_lesson_runs_in_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, commands = lesson(tmp_path)
    monkeypatch.chdir(tmp_path)
    toml = Path("contest.toml")
    toml.write_text(toml.read_text() + "duration = 0.3\n")
    InThisProcess(monkeypatch)
    assert [main(words) for words in commands] == [0, 0]
    rows = pq.read_table("results/results.parquet").to_pylist()
    assert {row["reason"] for row in rows if row["law"] == "WhileMoving"} == {""}


@pytest.mark.nightly
def test_the_lesson_ends_with_its_figures_and_the_order_that_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page, commands = lesson(tmp_path)
    monkeypatch.chdir(tmp_path)
    InThisProcess(monkeypatch, drawn=True)
    assert main(commands[0]) == 0
    printed = capsys.readouterr().out
    shown = re.search(r"```text\nlaw .*?\n(.*?)```", page, re.DOTALL)
    assert shown is not None
    for line in shown[1].splitlines():
        law, rank = line.split()[:2]
        assert re.search(rf"{law} +\w+ +{rank} ", printed), line
    found = {path.name for path in Path("results/figures").iterdir()}
    assert found == {f"{name}.{kind}" for name in ("ranks", "map", "course") for kind in ("pdf", "svg", "png")}
    assert 'width="248.4pt"' in Path("results/figures/map.svg").read_text()
    assert "WhileMoving &" in Path("results/table.tex").read_text()
    assert "adaptctl" in Path("results/cite.bib").read_text()
