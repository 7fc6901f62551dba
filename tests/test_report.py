"""Reports: whole in themselves, by the reader's setting, with no name taken for markup."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from comparisons import comparison

from adaptctl.dynamics import load
from adaptctl.recording import Comparison, Fact, Finding, RunRole, Setting, StepCost, write_artifacts
from adaptctl.recording.colors import INK, PAPER, TICKS
from adaptctl.recording.judgement import facts, joint_errors, outcome_words
from adaptctl.recording.page import Note, Table
from adaptctl.recording.report import _costs, _measured, report
from adaptctl.recording.result import answers
from docs.making.gallery import PAGE, PICTURES, SHOWN, outcome_of, pictures_of

pytestmark = pytest.mark.drawn


@pytest.fixture(scope="module")
def shown() -> Comparison:
    return comparison(load("two_link"))


@pytest.fixture(scope="module")
def folder(shown: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_artifacts(tmp_path_factory.mktemp("run") / "deep" / "er", shown)


class Page(HTMLParser):
    """The links, images and text of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.images: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.links += [given[name] or "" for name in ("src", "href") if name in given]
        if tag == "img":
            self.images.append(given["src"] or "")

    def handle_data(self, data: str) -> None:
        self.text += data


def test_figures_are_pictures_of_a_readable_size(folder: Path) -> None:
    figures = list((folder / "figures").iterdir())
    assert len(figures) > 3
    for path in figures:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG\r\n")
        width = int.from_bytes(data[16:20])
        assert 1300 < width < 1700
        assert len(data) > 10_000


def test_report_needs_nothing_but_itself(folder: Path) -> None:
    html = (folder / "report.html").read_text()
    page = Page(html)
    assert page.links == page.images
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "http" not in html
    assert "url(" not in html
    embedded = {base64.b64decode(image.removeprefix("data:image/png;base64,")) for image in page.images}
    assert embedded == {path.read_bytes() for path in (folder / "figures").iterdir()}


def test_report_says_it_all_and_takes_no_name_for_markup(folder: Path, shown: Comparison) -> None:
    text = Page((folder / "report.html").read_text()).text
    assert "Slotine-Li, <learning>" in text
    assert outcome_words(shown) in text
    for equation in shown.basis.equations():
        assert equation in text
    for name in shown.basis.names:
        assert name in text
    assert "rerun recording.rrd" in text
    assert "interrupted" not in text


def test_a_report_says_passed_and_the_last_error_of_each_joint(folder: Path, shown: Comparison) -> None:
    told = (folder / "report.html").read_text()
    each = joint_errors(shown)
    assert [name for name, *_ in each] == list(shown.joint_names)
    assert answers(facts(shown))["Verdict"] == "passed"
    assert answers(facts(shown, by_joint=True))["… of each joint"].startswith(f"{each[0][0]} {each[0][2]}, ")
    for _, first, last in each:
        assert re.fullmatch(r"\S+ mrad", last)
        assert first in told
        assert last in told


def test_notes_are_shown_with_the_results(shown: Comparison) -> None:
    noted = replace(shown, settings=(*shown.settings, Setting("note 1", "no rotors", "on the tuning")))
    sections = {section.title: section for section in report(noted).sections}
    assert Note("no rotors", head="Note.", warning=True) in sections["Experiment"].parts
    assert "no rotors" not in str(sections["Settings"].parts[0])


def test_parameters_that_are_kept_are_those_of_the_basis(shown: Comparison) -> None:
    parts = [part for section in report(shown).sections for part in section.parts]
    (table,) = (part for part in parts if isinstance(part, Table) and part.header[0] == "kept")
    kept = {f"{row[0]}.{table.header[k]}" for row in table.rows for k in range(1, len(row)) if row[k]}
    assert kept == set(shown.basis.names) & set(shown.space.parameter_names)


def test_what_runs_were_measured_by_is_told_run_by_run(shown: Comparison) -> None:
    findings = (
        Finding("peak_speed.adaptive", 2.5, "rad/s", "Peaks: largest speed"),
        Finding("peak_speed.adaptation-off", 3.5, "rad/s", "Peaks: largest speed"),
        Finding("share.adaptation-off", 0.5, "1", "Parts: share of the time"),
        Finding("share.nobody", 9.0, "1", "of no run"),
    )
    table = _measured(replace(shown, findings=findings))
    assert table is not None
    assert list(table.header) == ["controller", "peak speed [rad/s]", "share"]
    assert [tuple(row[1:]) for row in table.rows] == [("2.5", "–"), ("3.5", "0.5")]
    assert table.note == "peak speed [rad/s]: largest speed. share: share of the time."
    assert _measured(replace(shown, findings=findings[3:])) is None


def test_costs_of_a_step_are_told_as_far_as_they_are_known(shown: Comparison) -> None:
    def told(*costs: StepCost | None) -> tuple[tuple[str, ...], list[list[str]]]:
        runs = tuple(replace(run, cost=cost) for run, cost in zip(shown.runs, costs, strict=True))
        words, table = _costs(replace(shown, runs=runs))
        assert isinstance(table, Table)
        assert ("Times are measured" in str(words)) == (len(table.header) > 2)
        return tuple(table.header[1:]), [[cell.text for cell in row[1:]] for row in table.cells]

    assert told(StepCost(5.04e-6, 2.4e-7, 1470), None) == (
        ("operations", "native", "called"),
        [["1,470", "240 ns", "5.0 µs"], ["–", "–", "–"]],
    )
    assert told(StepCost(flops=0), StepCost(flops=9)) == (("operations",), [["0"], ["9"]])
    assert told(StepCost(native=1.2e-6), None) == (("operations", "native"), [["–", "1,200 ns"], ["–", "–"]])


def test_report_follows_the_reader(folder: Path) -> None:
    """Light or dark as the reader's setting says; every column is headed, and narrow screens head every number."""
    html = (folder / "report.html").read_text()
    assert "prefers-color-scheme: dark" in html
    assert '<meta name="color-scheme" content="light dark">' in html
    assert not re.search(r"<th[^>]*>\s*</th>", html)
    tables = re.findall(r'<table class="rows">.*?<tbody>(.*?)</tbody>', html, re.DOTALL)
    assert tables
    for row in re.findall(r"<tr.*?</tr>", " ".join(tables), re.DOTALL):
        cells = re.findall(r"<td([^>]*)>", row)
        assert len(cells) > 1
        assert all("data-of=" in cell for cell in cells[1:])


def test_a_failure_is_marked_and_phones_get_figures_of_their_own(shown: Comparison, tmp_path: Path) -> None:
    failed = replace(report(shown), outcome="Failed: <it> fell.")
    failed.write(tmp_path / "run", figures=False)
    html = (tmp_path / "run" / "report.html").read_text()
    assert '<b class="failed">Failed:</b> &lt;it&gt; fell.' in html
    narrow = re.findall(r'<source media="[^"]*" srcset="data:image/svg\+xml;base64,([^"]*)">', html)
    assert len(narrow) == len([one for one in failed.drawings if one.plain]) > 3
    widths = {re.search(rb'viewBox="0 0 (\S+) ', base64.b64decode(one))[1] for one in narrow}  # type: ignore[index]
    assert widths == {b"248.4"}  # points, of 3.45 inches


def test_text_of_a_report_stands_out_from_its_ground() -> None:
    """Ratios of contrast are at least 4.5 (WCAG 2.2, 1.4.3), light and dark."""
    page = Path("adaptctl/recording/page.html").read_text()
    themes = [dict(re.findall(r"--(\w+): (#[0-9a-f]{3,6});", part)) for part in page.split(":root {")[1:3]]
    for theme in themes:
        for ink in ("ink", "soft", "accent", "warm"):
            for ground in ("paper", "wash", "card"):
                assert contrast(theme[ink], theme[ground]) >= 4.5, (ink, ground)
    assert min(contrast(ink.hex, PAPER.hex) for ink in (INK, TICKS)) >= 4.5


def contrast(one: str, other: str) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(color: str) -> float:
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_only_what_learns_and_what_does_not_are_coloured(folder: Path, shown: Comparison) -> None:
    """Blue and orange mean the subject and the same with adaptation off; other numbers have no colour."""
    html = (folder / "report.html").read_text()
    tiles = dict(re.findall(r'<div class="tile([^"]*)"><span>([^<]*)', html))
    assert tiles[" subject"] == "RMS error, last 2 s"
    assert tiles[" off"] == "… without adaptation"
    bare = report(replace(shown, runs=shown.runs[:1])).html({})
    assert {kind for kind, _ in re.findall(r'<div class="tile([^"]*)"><span>([^<]*)', bare)} == {""}


def test_colours_of_tiles_are_those_of_the_facts_whatever_their_words(
    shown: Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = [Fact("before", "1"), Fact("ours", "2", RunRole.SUBJECT), Fact("theirs", "3", RunRole.BASELINE)]
    monkeypatch.setattr("adaptctl.recording.report.facts", lambda _comparison: told)
    html = report(shown).html({})
    assert re.findall(r'<div class="(tile[ a-z]*)"><span>(.*?)</span><b>(.*?)</b>', html) == [
        ("tile", "before", "1"), ("tile subject", "ours", "2"), ("tile off", "theirs", "3"),
    ]  # fmt: skip
    assert all(f".{fact.role.value} b {{" in html for fact in told[1:])


def test_the_gallery_tells_what_a_report_says_first(folder: Path, shown: Comparison, tmp_path: Path) -> None:
    assert outcome_of(folder / "report.html") == outcome_words(shown)
    assert outcome_of(tmp_path / "nothing.html") == ""


def test_a_page_repeats_the_gallery_s_figures() -> None:
    [told] = re.findall(r"^The RMS .* from the identified estimate.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    page = (PAGE.parent / "identification.md").read_text(encoding="utf-8")
    [paragraph] = [part for part in page.split("\n\n") if "run identify-then-adapt`" in part]
    figures = re.findall(r"[\d.]+ mrad", told)
    assert len(figures) == 3
    assert re.findall(r"[\d.]+ mrad", paragraph)[:3] == figures


def test_the_gallery_has_every_experiment_with_picture_command_and_outcome() -> None:
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    assert [part.partition("\n")[0] for part in parts] == [entry.name for entry in SHOWN]
    for entry, part in zip(SHOWN, parts, strict=True):
        for file in pictures_of(entry.name):
            assert (PICTURES / file).is_file()
            assert f"](images/gallery/{file})" in part
        apart = "" if entry.arguments == entry.name else f" --out results/{entry.name}"
        [command] = re.findall(r"```console\n(.*?)\n```", part, re.DOTALL)
        assert " ".join(command.replace("\\\n", " ").split()) == f"adaptctl experiment run {entry.arguments}{apart}"
        assert max(map(len, command.splitlines())) <= 80
        assert re.search(rf"{re.escape(entry.summary)}\.\n\n\S.*\.\n", part), entry.name
