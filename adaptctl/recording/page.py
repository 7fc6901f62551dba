"""Reports as data: a title, an outcome, facts and sections of texts, tables and figures, of any result.

A result says what its page holds; `Report.write` makes a folder of it: summary, figures, page and recording.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

from adaptctl.files import write_json, write_text
from adaptctl.optional_packages import needed
from adaptctl.recording.drawing import Drawing, write_drawings
from adaptctl.recording.result import FIGURES, RECORDING, REPORT, SUMMARY, Fact, Progress, all_or_none, silent

if TYPE_CHECKING:
    import jinja2

HOME = "adaptctl.recording"
SHEU_WALKER = (
    "S.-Y. Sheu and M. W. Walker, Identifying the Independent Inertial Parameter Space of Robot Manipulators, "
    "International Journal of Robotics Research 10(6), 1991"
)
"""the paper that the method is from"""
INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole experiment."


class Tone(Enum):
    """Enumeration of the tones of a table's cell or badge; the value is its style in the page. PLAIN has none, QUIET is
    grey, GOOD green, FAIR blue, ODD orange and BAD red."""

    PLAIN = ""
    QUIET = "quiet"
    GOOD = "good"
    FAIR = "fair"
    ODD = "odd"
    BAD = "bad"


class TableLayout(Enum):
    """Enumeration of the layouts of a table. PLAIN is a table on every screen; on narrow ones ROWS, of many columns,
    names the column beside every number, and STACKED, of names and sentences, sets a row's cells one below the other;
    HALVES, of many rows, is two tables beside each other on wide ones; GRID has marks in its cells; WIDE can be moved
    sideways."""

    PLAIN = ""
    ROWS = "rows"
    STACKED = "stacked"
    HALVES = "halves"
    GRID = "grid"
    WIDE = "wide"


class Cell(NamedTuple):
    """Cell of a table with more than its `text`: `note`, small below it, empty by default; `tone`, none by default;
    `badge`, True where the tone is that of a rounded label about the text alone, not of the cell; `swatch`, a colour
    such as "#1b6cd6" shown before it; `hint`, shown where a pointer rests; and `mark`, True or False where a large or a
    small mark is shown in the text's place, None by default. Nothing is checked at construction."""

    text: str
    note: str = ""
    tone: Tone = Tone.PLAIN
    badge: bool = False
    swatch: str = ""
    hint: str = ""
    mark: bool | None = None


@dataclass(frozen=True)
class Table:
    """Table of a report. `header` has the n columns' headings and `rows` as many cells each: texts, `Cell` where more
    than a text, or True and False, which are shown as marks with the words `marks`. `title` is a heading above the
    table and `note` a text below it, empty by default. `align` has a letter for each column: "l" for texts, "r" for
    numbers, "c" for names in code, "s" for small texts such as units; what is missing
    is "l". `marked` are the zero-based indices of rows that stand out, none by default. Nothing is checked at
    construction."""

    header: Sequence[str]
    rows: Sequence[Sequence[str | bool | Cell]]
    title: str = ""
    note: str = ""
    align: str = ""
    layout: TableLayout = TableLayout.PLAIN
    marked: Collection[int] = ()
    marks: tuple[str, str] = ("yes", "no")
    kind: ClassVar[str] = "table"

    @property
    def styles(self) -> list[str]:
        """One letter for each of the n columns, `align` filled up with "l"."""
        return list(self.align.ljust(len(self.header), "l"))

    @property
    def cells(self) -> list[list[Cell]]:
        """All rows, with every cell as a `Cell`."""
        return [[self._cell(cell) for cell in row] for row in self.rows]

    @property
    def parts(self) -> list[list[list[Cell]]]:
        """The rows of each table in the page: two halves of them, the first the longer, in the layout HALVES."""
        middle = -(-len(self.rows) // 2) if self.layout is TableLayout.HALVES else len(self.rows)
        return [rows for rows in (self.cells[:middle], self.cells[middle:]) if rows] or [[]]

    def markdown(self) -> str:
        """The table in Markdown, without notes and tones."""
        rows = [[cell.text for cell in row] for row in self.cells]
        lines = ["| " + " | ".join(row) + " |" for row in ([*self.header], *rows)]
        return "\n".join([lines[0], "|" + "---|" * len(self.header), *lines[1:]])

    def _cell(self, cell: str | bool | Cell) -> Cell:
        if isinstance(cell, bool):
            return Cell(self.marks[not cell], mark=cell)
        return Cell(cell) if isinstance(cell, str) else cell


@dataclass(frozen=True)
class Note:
    """Paragraph of a report in small letters: `text`, after `head` in bold, empty by default; a `warning` stands out.
    Nothing is checked at construction."""

    text: str
    head: str = ""
    warning: bool = False
    kind: ClassVar[str] = "note"

    def markdown(self) -> str:
        """The paragraph in Markdown."""
        return f"**{self.head}** {self.text}" if self.head else self.text


@dataclass(frozen=True)
class Lines:
    """Lines of a report, such as equations, in letters of one width; `beside`, none by default, are others, on wide
    screens beside them. With `bullets` they are a list of sentences; `title` is a heading above them, empty by
    default. Nothing is checked at construction."""

    lines: Sequence[str]
    beside: Sequence[str] = ()
    bullets: bool = False
    title: str = ""
    kind: ClassVar[str] = "lines"

    def markdown(self) -> str:
        """The lines in Markdown: a list with `bullets`, else a block of code."""
        head = f"### {self.title}\n\n" if self.title else ""
        return head + "\n".join(("- " if self.bullets else "    ") + line for line in (*self.lines, *self.beside))


@dataclass(frozen=True)
class Fragment:
    """Piece of HTML for a report that its maker has escaped, such as a live arm. It is in the page alone, not in a
    recording. Nothing is checked at construction."""

    html: str
    kind: ClassVar[str] = "fragment"

    def markdown(self) -> str:
        """An empty text: what is HTML alone is not in a recording."""
        return ""


Part: TypeAlias = str | Note | Lines | Table | Drawing | Fragment
"""What a section of a report holds; a text is a paragraph."""


@dataclass(frozen=True)
class Section:
    """Section of a report: its heading `title`, and `parts` in their order. Without a title the parts stand by
    themselves. `badge` is a label beside the heading, and `name` the anchor that a page's links lead to, neither by
    default. Nothing is checked at construction."""

    title: str
    parts: Sequence[Part]
    badge: Cell | None = None
    name: str = ""


@dataclass(frozen=True)
class Report:
    """Report of any result, from which page, figures, recording and summary are written. `experiment` is the name of
    the experiment or command, `title` a few words; `outcome` is the result in a sentence or two, made where it was
    judged; `facts` are the questions that a person asks first, with their answers, of which the page shows eight;
    `sections` hold the rest. `about` stands beside the name, such as "seed 7"; `seed` is that of the random numbers, 0
    by default; `complete` is False where the experiment was interrupted, which page and recording then say in the words
    `incomplete`; `source` is a line at the page's foot on where the method is published. Nothing is checked at
    construction."""

    experiment: str
    title: str
    outcome: str
    facts: Sequence[Fact] = ()
    sections: Sequence[Section] = ()
    about: str = ""
    seed: int = 0
    complete: bool = True
    incomplete: str = INCOMPLETE
    source: str = ""

    @property
    def drawings(self) -> list[Drawing]:
        """The figures of all sections, in their order."""
        return [part for section in self.sections for part in section.parts if isinstance(part, Drawing)]

    def html(self, figures: Mapping[str, Path]) -> str:
        """The page, as text, that needs no other file. `figures` maps the drawings' names to PNG files, which go into
        the page; a drawing without a file is left out. Raises `OSError` where a PNG file cannot be read."""
        data = {name: base64.b64encode(file.read_bytes()).decode("ascii") for name, file in figures.items()}
        return rendered("page.html", HOME, report=self, figures=data)

    def markdown(self, *parts: Part) -> str:
        """Text in Markdown for a recording: the outcome, and `parts` after it; without any, facts and all sections."""
        given = parts or (answers_table(self.facts), *_of_sections(self.sections))
        warning = () if self.complete else (f"**{self.incomplete}**",)
        texts = (part if isinstance(part, str) else part.markdown() for part in given if not isinstance(part, Drawing))
        return "\n\n".join(filter(None, (*warning, self.outcome, *texts))) + "\n"

    def record(self, path: str | Path, figures: Mapping[str, Path]) -> None:
        """Write a recording without motion for the rerun viewer to the file `path` (.rrd), whole or not at all: the
        text beside the pictures in the PNG files `figures`, by name. Raises `FileError` where it cannot be written or
        read back, `OSError` where a PNG file cannot be read."""
        from adaptctl.recording.stream import write_illustrated

        write_illustrated(Path(path), self, self.markdown(), figures)

    def write(
        self,
        folder: str | Path,
        summary: Mapping[str, Any] | None = None,
        *,
        name: str = SUMMARY,
        tables: Mapping[str, Callable[[Path], object]] | None = None,
        record: Callable[[Path, Mapping[str, Path]], object] | None = None,
        progress: Progress = silent,
    ) -> Path:
        """Write the report's folder, which is made where it is missing, and return its path: the `summary`, in JSON's
        types, as the file `name`, "summary.json" by default, none where it is None; files such as trace.parquet, by
        name in `tables`, each by a function that gets its path; figures as PNG in the subfolder figures; report.html;
        and recording.rrd, by `record`, a function of its path and of the figures' paths by name, by default `record` of
        this report. Either all are written, each over an existing file of its name, or none, where one cannot be
        written or `progress` raises. `progress(what, share)` is called with what is being written and the fraction
        done, 0 to 1. Raises `FileError` where a file cannot be written, and for numbers in `summary` that are NaN or
        infinite."""
        with all_or_none(folder, last=name) as beside:
            progress("summary", 0.0)
            if summary is not None:
                write_json(beside / name, summary)
            for table, write in (tables or {}).items():
                write(beside / table)
            progress("figures", 0.1)
            (beside / FIGURES).mkdir()
            figures = write_drawings(beside / FIGURES, self.drawings)
            progress("recording", 0.7)
            (record or self.record)(beside / RECORDING, figures)
            progress("report", 0.95)
            write_text(beside / REPORT, self.html(figures))
            progress("report", 1.0)
        return Path(folder)


def _of_sections(sections: Iterable[Section]) -> Iterator[Part]:
    for section in sections:
        if section.title:
            yield f"## {section.title}"
        yield from section.parts


def answers_table(facts: Sequence[Fact]) -> Table:
    """Table of a result's `facts` with two questions and answers a row, for a recording's text. Without facts it has no
    rows. Nothing is raised."""
    cells = [cell for fact in facts for cell in (fact.question, f"**{fact.answer}**")]
    cells += ["", ""] * (len(facts) % 2)
    rows = [cells[i : i + 4] for i in range(0, len(cells), 4)]
    return Table(rows[0], rows[1:]) if rows else Table((), ())


def settings_section(settings: Iterable[Any], *more: Part) -> Section:
    """Section of a report with an experiment's `settings`, each with `name`, `value` and `meaning`, as a table, and
    `more` parts below it. Nothing is checked."""
    rows = [(setting.name, setting.value, setting.meaning) for setting in settings]
    table = Table(("setting", "value", "meaning"), rows, align="cll", layout=TableLayout.STACKED)
    return Section("Settings", (table, *more))


def files_section(
    recording: str, summary: str, tables: Mapping[str, str] | None = None, name: str = SUMMARY
) -> Section:
    """Section of a report on the files beside it: `recording` and `summary` are sentences on what is in recording.rrd
    and in the JSON file `name`, "summary.json" by default; `tables` maps names of Parquet files to sentences, None for
    no such file. Nothing is checked."""
    rows = [
        (RECORDING, f"{recording} Open it with: rerun {RECORDING}; the viewer is installed with adaptctl."),
        (name, summary),
        *(
            (file, f'{meaning} Read it with pyarrow.parquet.read_table("{file}").')
            for file, meaning in (tables or {}).items()
        ),
        (f"{FIGURES}/", "The figures of this page as PNG."),
    ]
    table = Table(("file", "what is in it"), rows, align="cl", layout=TableLayout.STACKED)
    return Section("The files beside this page", (table,))


@cache
def _environment(package: str) -> jinja2.Environment:
    with needed("a report"):
        import jinja2

    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def rendered(template: str, package: str, **content: object) -> str:
    """HTML, as text, made from a Jinja template: the file named `template` in the folder of the Python package
    `package`. `content` has the template's variables, by name; texts among them are escaped for HTML. Raises Jinja's
    `TemplateNotFound` for a template that does not exist, its `UndefinedError` for a variable that the template uses
    and `content` lacks, and `MissingExtraError` without Jinja."""
    return _environment(package).get_template(template).render(**content)
