"""Reports as data: what a result says is what its page, its recording's text and its folder hold."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from rerun.chunk import RrdReader

from adaptctl.errors import FileError
from adaptctl.recording.drawing import Drawing, write_for_paper
from adaptctl.recording.page import (
    Cell,
    Fragment,
    Lines,
    Note,
    Report,
    Section,
    Table,
    TableLayout,
    Tone,
    answers_table,
    files_section,
)
from adaptctl.recording.result import Fact


class Read(HTMLParser):
    """The rows of a page's tables, the text of its headings, and all its text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.text = ""
        self.inside = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self.inside = True

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.inside:
            self.tables[-1][-1][-1] += data.strip()


def line() -> Figure:
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0])
    return figure


ROWS = [("<b>1</b>", "1.5"), ("two", "2.5"), ("three", "3.5")]
TABLE = Table(("what & why", "value"), ROWS, title="Numbers", note="In metres.", align="cr", marked=(1,))


def report(complete: bool = True) -> Report:
    flags = Table(
        ("kept", "mass"), [("link1", True), ("link2", False)], layout=TableLayout.GRID, marks=("stays", "goes")
    )
    cells = Table(
        ("entry", "computed"),
        [
            ("a", Cell("0.1", "printed 0.2", Tone.BAD, hint="0.1 to 0.3")),
            ("b", Cell("fine", tone=Tone.GOOD, badge=True)),
        ],
        layout=TableLayout.ROWS,
    )
    parts = ("A paragraph with <names>.", TABLE, flags, cells, Drawing("line", 'A "line".', line))
    lines = (Lines(["m1 + m2"], ["m3"]), Lines(["one", "other"], bullets=True), Note("a hand.", head="By"))
    return Report(
        experiment="by-hand",
        title="Made <by hand>",
        outcome="It is & it is not.",
        facts=[Fact("how much", "much"), Fact("when", "now"), Fact("where", "here")],
        sections=(
            Section("First", parts, badge=Cell("proved", tone=Tone.FAIR), name="first"),
            Section("", (Fragment("<em>live</em>"),)),
            Section("Lines", lines),
            files_section("All.", "Numbers.", {"trace.parquet": "Rows."}),
        ),
        about="seed 3",
        seed=3,
        complete=complete,
        source="S.-Y. Sheu and M. W. Walker, 1991.",
    )


def test_files_without_tables_are_a_recording_a_summary_and_figures() -> None:
    (table,) = files_section("All.", "Numbers.").parts
    assert [row[0] for row in table.rows] == ["recording.rrd", "summary.json", "figures/"]


def test_every_cell_is_in_the_page_and_nothing_is_taken_for_markup() -> None:
    html = report().html({})
    read = Read(html)
    assert [tuple(row) for row in read.tables[0]] == [("what & why", "value"), *ROWS]
    assert read.tables[1] == [["kept", "mass"], ["link1", "stays"], ["link2", "goes"]]
    assert read.tables[2] == [["entry", "computed"], ["a", "0.1printed 0.2"], ["b", "fine"]]
    for text in (
        "Made <by hand>",
        "It is & it is not.",
        "A paragraph with <names>.",
        "m1 + m2",
        "m3",
        "seed 3",
        "1991",
    ):
        assert text in read.text
    assert "<em>live</em>" in html
    assert "<b>1</b>" not in html
    assert re.search(r'<section id="first">\s*<h2>First <i class="badge fair">proved</i></h2>', html)


def test_styles_are_those_of_the_data() -> None:
    html = report().html({})
    assert "<td><code>two</code></td>" in html
    assert '<td class="n">2.5</td>' in html
    assert re.findall(r'<tr class="subject">\s*<td><code>(\w+)', html) == ["two"]
    assert '<td class="bad" data-of="computed" title="0.1 to 0.3">' in html
    assert '<td data-of="computed"><i class="badge good">fine</i></td>' in html


def test_halves_of_a_table_are_all_of_it() -> None:
    whole = Table(("n",), [(str(k),) for k in range(5)], layout=TableLayout.HALVES)
    assert [len(rows) for rows in whole.parts] == [3, 2]
    assert [row for rows in whole.parts for row in rows] == whole.cells
    assert Table(("n",), []).parts == [[]]
    html = Report("by-hand", "Title", "Outcome", sections=(Section("Halves", (whole,)),)).html({})
    assert [len(rows) for rows in Read(html).tables] == [4, 3]
    assert html.count('class="halves"') == 1  # of what holds both tables; a table so laid out loses its columns


def test_markdown_is_the_same_table() -> None:
    assert TABLE.markdown().splitlines() == [
        "| what & why | value |", "|---|---|", "| <b>1</b> | 1.5 |", "| two | 2.5 |", "| three | 3.5 |"
    ]  # fmt: skip
    text = report(complete=False).markdown()
    assert text.startswith("**This run was interrupted:")
    assert "| how much | **much** | when | **now** |" in text
    assert "| where | **here** |  |  |" in text
    assert "| link2 | goes |" in text
    assert "live" not in text
    assert report().markdown("Only this.") == "It is & it is not.\n\nOnly this.\n"
    assert answers_table(()).rows == ()


def test_an_interrupted_result_says_so() -> None:
    assert "Incomplete." in report(complete=False).html({})
    assert "Incomplete." not in report().html({})


def test_a_folder_holds_what_the_report_says(tmp_path: Path) -> None:
    seen: list[tuple[str, float]] = []
    folder = report().write(
        tmp_path / "deep" / "er",
        {"numbers": [1.5]},
        tables={"notes.txt": lambda path: path.write_text("n")},
        progress=lambda what, share: seen.append((what, share)),
    )
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {"summary.json", "notes.txt", "figures/line.png", "report.html", "recording.rrd"}
    assert json.loads((folder / "summary.json").read_text()) == {"numbers": [1.5]}
    picture = (folder / "figures" / "line.png").read_bytes()
    page = (folder / "report.html").read_text()
    assert f'src="data:image/png;base64,{base64.b64encode(picture).decode()}" alt="A &#34;line&#34;."' in page
    entities = {str(path) for path in RrdReader(folder / "recording.rrd").store().schema().entity_paths()}
    assert {"/summary", "/figures/line"} <= entities
    assert [share for _, share in seen] == sorted(share for _, share in seen)
    assert seen[-1] == ("report", 1.0)


def test_a_report_without_random_numbers_is_recorded_as_of_seed_zero(tmp_path: Path) -> None:
    Report("by-hand", "Title", "Outcome").record(tmp_path / "a.rrd", {})
    (entry,) = RrdReader(tmp_path / "a.rrd").recordings()
    assert entry.recording_id.startswith("by-hand-seed0-")


def test_figures_for_papers_are_the_same_whenever_they_are_written(tmp_path: Path) -> None:
    """Of as many dots per inch as journals ask for, and with texts that are of letters, not of drawings of them."""
    pdf, svg, png = write_for_paper(tmp_path, [Drawing("line", "", line)])
    assert [path.name for path in (pdf, svg, png)] == ["line.pdf", "line.svg", "line.png"]
    assert int.from_bytes(png.read_bytes()[16:20]) == 2 * 300
    assert b"/CIDFontType2" in pdf.read_bytes()
    assert b"CreationDate" not in pdf.read_bytes()
    assert "<dc:date>" not in svg.read_text()


@pytest.mark.parametrize("existing", [False, True])
def test_what_fails_leaves_the_folder_as_it_was(tmp_path: Path, existing: bool) -> None:
    folder = tmp_path / "run"
    if existing:
        folder.mkdir()
        (folder / "report.html").write_text("old")
    with pytest.raises(FileError, match=r"run/summary\.json.*x"):
        report().write(folder, {"x": float("nan")})
    with pytest.raises(ZeroDivisionError):
        report().write(folder, {}, record=lambda path, figures: 1 / 0)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == (["report.html"] if existing else [])
    assert folder.is_dir() == existing
