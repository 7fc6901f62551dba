"""The replication of Sheu and Walker (1991): its verdicts stand, and it runs from the command line."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from golden.capture import flattened
from golden.kept import kept, validate_same
from msgspec import structs
from nightly import turn_by_turn
from rerun.chunk import RrdReader

from adaptctl.cli.main import main
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments import find
from adaptctl.experiments.replication.arms import Arm, Study, near_parallelogram
from adaptctl.experiments.replication.judging import Check, Item, Number, Outturn, Paper, judged_item, printed
from adaptctl.experiments.replication.pages import Replication, headline, summary
from adaptctl.experiments.replication.puma560 import combination
from adaptctl.experiments.replication.semi_direct_drive import Decoupling
from adaptctl.experiments.sheu_walker_1991 import ITEMS, SheuWalker1991, chosen
from adaptctl.identifiability import fundamental_basis

pytestmark = [
    pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning"),
    pytest.mark.drawn,
]

COMMAND = ("experiment", "run", "sheu-walker-1991")


def untold(what: str, share: float) -> None:
    """Progress that nobody follows."""


def study(**settings: float) -> Study:
    """A study with some settings of its own."""
    usual = {"seed": 0, "seeds": 1, "samples": 101, "velocity_scale": 1.0, "frequency": 0.7, "motion_samples": 50}
    return Study(printed(), **{**usual, "unequal": 0.1, **settings})  # type: ignore[arg-type]  # whole where they are


@pytest.fixture(scope="module")
def replication() -> Replication:
    """The whole paper, as it is run by default."""
    with pytest.warns(match="not physically consistent"):
        return SheuWalker1991().replication(untold)


@pytest.fixture(scope="module")
def item(replication: Replication) -> Callable[[str], Item]:
    items = {item.name: item for item in replication.items}
    return lambda name: items[name]


def values(item: Item, part: str) -> tuple[float, ...]:
    """The numbers of the only evidence whose sentence has a part."""
    (found,) = (one.values for one in item.evidence if part in one.sentence)
    return found


def test_combinations_are_of_links_from_1_on() -> None:
    np.testing.assert_array_equal(np.flatnonzero(combination("I_x1 - I_x3")), [4, 24])
    with pytest.raises(InputError, match="link: expected a whole number of at least 1, got 0"):
        combination("I_x0")


def test_verdicts(replication: Replication) -> None:
    assert replication.complete
    given, reproduced, in_shape, erratum, not_reproduced = (
        Outturn.GIVEN,
        Outturn.REPRODUCED,
        Outturn.IN_SHAPE,
        Outturn.ERRATUM,
        Outturn.NOT_REPRODUCED,
    )
    assert replication.named(not_reproduced) == ["figure3", "table3", "table10"]
    assert "Neither reproduced nor proved wrong: figure3, table3, table10." in headline(replication)
    assert {item.name: item.verdict for item in replication.items} == {
        "figure1": reproduced,
        "table1": given,
        "table2": in_shape,
        "figure3": not_reproduced,
        "table3": not_reproduced,
        "figure4": in_shape,
        "table4": given,
        "table5": erratum,
        "table6": erratum,
        "table7": reproduced,
        "table8": reproduced,
        "table9": given,
        "table10": not_reproduced,
        "figure6": in_shape,
        "table11": given,
        "table12": reproduced,
        "table13": erratum,
        "section5.3": erratum,
        "conclusions": erratum,
    }


def test_numbers_are_those_kept(replication: Replication) -> None:
    """But for gaps, which are over round-off."""
    now = dict(flattened(json.loads(json.dumps(summary(replication)))))
    before = {name: x for name, x in kept("experiments/sheu-walker-1991")["numbers"].items() if not x > 1e9}
    validate_same(before, {name: now[name] for name in before})


def test_tables_7_and_8_to_their_digits(item: Callable[[str], Item]) -> None:
    assert sum(check.exact for check in item("table7").checks) == 53
    as_printed, rounded = values(item("table7"), "half unit")
    assert as_printed > 1.0 > rounded
    assert rounded == pytest.approx(0.7831, abs=2e-4)  # with exact masses and zeros, and nothing else exact
    off = re.search(r"to within (\S+);", item("table7").summary)
    assert off is not None
    assert 5e-4 < float(off[1]) < 9e-4  # half a digit, and the tolerance
    assert sum(check.exact for check in item("table8").checks) == 33


def test_table_5_is_dependent_and_comes_back_with_rounded_right_angles(item: Callable[[str], Item]) -> None:
    table = item("table5")
    assert values(table, "have rank")[0] == 33.0
    null = [one.values[0] for one in table.evidence if "changes torques" in one.sentence]
    assert len(null) == 3
    assert max(null) < 1e-14
    again = [one.values for one in table.evidence if "for pi/2" in one.sentence]
    assert [cells for cells, _, _ in again] == [60.0] * 4
    assert all(condition > 5e5 and right < 5.0 for _, condition, right in again)


def test_table_6_belongs_to_no_rigid_bodies(item: Callable[[str], Item]) -> None:
    assert values(item("table6"), "cannot be rigid")[0] == 5.0
    moment, outside = values(item("table6"), "consistent arm")
    assert moment == pytest.approx(-0.013)
    assert outside < 1e-14


def test_16_comes_from_energies_that_are_not_subtracted(item: Callable[[str], Item]) -> None:
    assert values(item("table13"), "Rank of energy differences") == (15.0, 16.0)
    assert values(item("table13"), "Undifferenced") == (37.0, 27.0)
    assert values(item("conclusions"), "first two joints")[:2] == (8.0, 15.0)


def test_decoupling_takes_ten_relations_or_six(item: Callable[[str], Item]) -> None:
    section = item("section5.3")
    assert values(section, "Generic:") == (4.0, 4.0, 4.0, 10.0)
    assert values(section, "Parallelogram:") == (2.0, 2.0, 2.0, 6.0)
    generic, parallelogram = section.found.relations.values()
    assert (len(generic), len(parallelogram)) == (10, 6)
    assert "link4.I_zz* = 0.37 link4.mc_x*" in generic
    assert "link5.mc_x* = 0.6667 link4.mc_x*" in parallelogram
    assert values(section, "rigid bodies")[1] > 0.0
    assert max(values(section, "off-diagonal inertia is")) < 1e-12
    assert section.checks[0].computed == "23"


def with_moved(study: Study, name: str, moved: Callable[[str, str, str], str]) -> Study:
    """The study, with all that is computed, of a paper that prints other entries in one table."""
    table = study.paper.items[name]
    rows = {
        row: " ".join(moved(row, column, text) for column, text in zip(table.columns, texts.split(), strict=True))
        for row, texts in table.rows.items()
    }
    items = study.paper.items | {name: structs.replace(table, rows=rows)}
    return with_paper(study, structs.replace(study.paper, items=items))


def with_paper(study: Study, paper: Paper) -> Study:
    """The study of another paper, with all that is computed."""
    changed = replace(study, paper=paper)
    changed.__dict__.update({key: value for key, value in study.__dict__.items() if key not in changed.__dict__})
    for arm in changed.__dict__.values():
        if isinstance(arm, Arm):
            vars(arm)["study"] = changed
    return changed


def beyond(check: Check, tolerance: float, direction: int) -> str:
    """The entry, moved by its tolerance: a cross for a blank, a number out of its bounds, printed as it was."""
    if check.is_mark:
        return "." if check.printed == "x" else "x"
    number = Number.of(check.printed)
    if check.low is not None and check.high is not None:
        edge = check.low if direction < 0 else check.high
        return f"{edge * (1.0 + 0.25 * direction):.1E}"
    if check.verdict is Outturn.IN_SHAPE:
        target = max(1e3, 1e3 * abs(number.value))
    else:
        target = number.value + direction * max(math.ceil(tolerance / number.unit), 1.0) * number.unit
    return number.styled(target)


FAILING = {Outturn.NOT_REPRODUCED, Outturn.ERRATUM}


@pytest.mark.parametrize(
    ("name", "direction"), turn_by_turn([name for name in ITEMS if printed().items[name].rows], [-1, 1])
)
def test_every_verdict_fails_where_a_printed_number_is_moved_by_its_tolerance(
    replication: Replication, item: Callable[[str], Item], name: str, direction: int
) -> None:
    """Away from what is computed where that is off the printed number, so that both differ by more than is allowed."""
    table, checks = printed().items[name], {(check.row, check.column): check for check in item(name).checks}

    def moved(row: str, column: str, text: str) -> str:
        check = checks.get((row, column))
        if check is None or check.verdict in FAILING:
            return text
        off = 0.0 if check.is_mark else Number.of(text).value - computed(row, column, check)
        away = direction if abs(off) < 1e-12 or check.low is not None else int(math.copysign(1, off))
        return beyond(check, table.tolerance, away)

    found = item(name).found

    def computed(row: str, column: str, check: Check) -> float:
        assert found.entry is not None
        value = found.entry(row, column)
        return float(value) if isinstance(value, int | float) else Number.of(check.printed).value

    study = with_moved(replication.study, name, moved)
    now = judged_item(name, study.paper, ITEMS[name](study), study.numbers)
    for check in now.checks:
        before = checks[check.row, check.column]
        if before.verdict not in FAILING:
            assert check.printed != before.printed
            assert check.verdict is Outturn.NOT_REPRODUCED, f"{check.row}, {check.column}: {check.printed}"
    assert now.verdict is Outturn.NOT_REPRODUCED


@pytest.mark.parametrize("name", ["table5", "table13", "conclusions"])
def test_an_erratum_comes_out_where_the_paper_prints_what_is_computed(
    replication: Replication, item: Callable[[str], Item], name: str
) -> None:
    right = {(check.row, check.column): check.computed or "." for check in item(name).checks}
    study = with_moved(replication.study, name, lambda row, column, text: right[row, column])
    now = judged_item(name, study.paper, ITEMS[name](study), study.numbers)
    assert {check.verdict for check in now.checks} == {Outturn.REPRODUCED}


@pytest.mark.parametrize(
    ("claim", "name", "numbers"),
    [
        ("puma_rank", "table2", "37"),
        ("puma_rank", "table2", "35"),
        ("puma_first_34", "table2", "33"),
        ("puma_torque", "table3", "36"),
        ("puma_independent", "table5", "35"),
        ("arm_torque", "table10", "25"),
        ("arm_rank", "table12", "25"),
        ("arm_independent", "table12", "27"),
        ("torque_34_20", "conclusions", "36 20"),
        ("torque_34_20", "conclusions", "34 25"),
    ],
)
def test_a_claim_fails_where_its_number_is_another(
    replication: Replication, item: Callable[[str], Item], claim: str, name: str, numbers: str
) -> None:
    study = replication.study
    saying = study.paper.claims[claim]
    claims = study.paper.claims | {claim: structs.replace(saying, numbers=numbers)}
    changed = with_paper(study, structs.replace(study.paper, claims=claims))
    before, now = item(name), judged_item(name, changed.paper, ITEMS[name](changed), study.numbers)
    place = next(i for i, one in enumerate(before.claims) if one.quote == saying.quote)
    assert before.claims[place].verdict not in FAILING
    assert now.claims[place].verdict is Outturn.NOT_REPRODUCED


def test_all_that_the_paper_prints_is_looked_at(replication: Replication) -> None:
    assert [item.name for item in replication.items] == list(printed().items) == list(ITEMS)
    for item in replication.items:
        marked = item.name in ("table5", "table12")
        expected = sum(marked or text != "." for _, _, text in printed().items[item.name].entries())
        assert len(item.checks) == expected
    claims = {claim.quote for item in replication.items for claim in item.claims}
    assert claims == {saying.quote for saying in printed().claims.values()}


def test_the_motion_goes_through_the_whole_range() -> None:
    motion = study(frequency=0.7, motion_samples=25).five_bar.motion
    bend = motion.p[:, 1] - motion.p[:, 2]
    assert bend.min() == pytest.approx(0.5236)
    assert bend.max() == pytest.approx(2.618)
    np.testing.assert_allclose(motion.p[0], motion.p[-1], atol=1e-12)


def test_torque_errors_are_means_of_squares() -> None:
    arm = study(seed=5, seeds=2, velocity_scale=1.0, frequency=0.5, motion_samples=50).puma
    for seed, s in ((0, 10), (1, 30)):
        off = arm.motion.Y @ (arm.reductions[seed].parameters(s) - arm.parameters)
        np.testing.assert_allclose(arm.torque_errors[seed, s], np.mean(off**2, axis=0), rtol=1e-9)
    assert arm.torque_errors[:, 36].max() < 1e-18


def test_parameters_under_the_relations_decouple_the_arm() -> None:
    arm = Arm(study(), near_parallelogram(0.1))
    needs = Decoupling.of(arm, fundamental_basis(arm.space))
    F = needs.of_parameters()
    D = arm.parameters - np.linalg.pinv(F) @ (F @ arm.parameters)
    p, _ = arm.states(np.random.default_rng(3), 50, 1.0)
    M = arm.mechanism.with_parameters(D).mass_matrix(p)
    assert np.abs(M[:, [0, 0, 1], [1, 2, 2]]).max() < 1e-12
    assert len(needs.relations) + needs.left == 26


def test_chosen_names_come_in_the_paper_s_order() -> None:
    assert chosen(("table7", "figure1")) == ("figure1", "table7")
    assert chosen(("all",)) == tuple(ITEMS)
    with pytest.raises(
        NotFoundError, match=r"unknown item 'tabel7' \(did you mean 'table7'\?\); items: figure1, table1, "
    ):
        chosen(("table1", "tabel7"))


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--only", "table14"), "only: unknown item 'table14'"),
        (("--only", "table7", "figure2"), "items: figure1, table1, table2"),
        (("--seeds", "1"), "seeds: expected a whole number from 2 to 10000, got 1"),
        (("--samples", "20"), "samples: expected a whole number from 62"),
        (("--frequency", "nan"), "frequency: expected a number"),
        (("--unequal", "0"), "unequal: expected a number from"),
    ],
)
def test_wrong_settings_are_told(
    flags: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMMAND, *flags, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_run_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [*COMMAND, "--only", "table7", "figure4", "table5", "--seeds", "3", "--out", str(tmp_path)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "Of 60 printed numbers that can be computed from the paper, 60 agree, 53 to the last digit" in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert list(summary["items"]) == ["figure4", "table5", "table7"]
    assert summary["numbers"]["reproduced"] == 60
    assert summary["errata"] == ["table5"]
    draws = pq.read_table(tmp_path / "trace.parquet")
    assert draws["arm"].to_pylist() == ["puma560"] * 3 * 36
    assert draws["seed"].to_pylist() == [seed for seed in range(3) for _ in range(36)]
    assert draws["number"].to_pylist() == list(range(1, 37)) * 3
    units = {name: draws.schema.field(name).metadata[b"unit"] for name in ("singular_value", "weight")}
    assert units == {"singular_value": b"J per SI unit", "weight": b"J"}
    assert math.isclose(draws["percent_error"][35].as_py(), 0.0)
    page = (tmp_path / "report.html").read_text()
    assert 'id="table7"' in page
    assert 'src="http' not in page
    assert 'href="http' not in page
    assert (tmp_path / "figures" / "figure-4.png").stat().st_size > 10_000
    entities = {str(chunk.entity_path) for chunk in RrdReader(tmp_path / "recording.rrd").store().stream()}
    assert {"/summary", "/figures/figure-4"} <= entities


def test_without_draws_or_figures_everything_is_written(tmp_path: Path) -> None:
    assert main([*COMMAND, "--only", "table4", "--out", str(tmp_path)]) == 0
    assert pq.read_table(tmp_path / "trace.parquet").num_rows == 0
    assert json.loads((tmp_path / "summary.json").read_text())["numbers"]["given"] == 60


def test_an_interruption_keeps_what_was_computed() -> None:
    def stop_at(count: int) -> Callable[[str, float], None]:
        told: list[str] = []

        def progress(what: str, share: float) -> None:
            told.append(what)
            if len(told) > count:
                raise KeyboardInterrupt

        return progress

    experiment = SheuWalker1991(only=("table1", "table4", "table6"))
    kept = experiment.replication(stop_at(2))
    assert [item.name for item in kept.items] == ["table1", "table4"]
    assert not kept.complete
    assert headline(kept).startswith("This run was interrupted")
    with pytest.raises(KeyboardInterrupt):
        experiment.replication(stop_at(0))


def test_the_experiment_is_in_the_list() -> None:
    assert find("sheu-walker-1991") is SheuWalker1991
