"""Reports as data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

from adaptctl.files import write_json, write_text
from adaptctl.folders import made_folder
from adaptctl.optional_packages import needed
from adaptctl.recording.drawing import Drawing, data_urls, narrow_urls, png_urls, write_drawings
from adaptctl.recording.result import FIGURES, RECORDING, REPORT, SUMMARY, Fact, Progress, all_or_none, silent

if TYPE_CHECKING:
    import jinja2

HOME = "adaptctl.recording"
# The paper that the method is from
SHEU_WALKER = (
    "S.-Y. Sheu and M. W. Walker, Identifying the Independent Inertial Parameter Space of Robot Manipulators, "
    "International Journal of Robotics Research 10(6), 1991"
)
INCOMPLETE = "This run was interrupted: the results are incomplete."


class Tone(Enum):
    """Tones of a cell or badge; the value is its style in the page."""

    PLAIN = ""
    QUIET = "quiet"
    GOOD = "good"
    FAIR = "fair"
    ODD = "odd"
    BAD = "bad"


class TableLayout(Enum):
    """Layouts of a table on narrow screens and in the page."""

    PLAIN = ""
    ROWS = "rows"
    STACKED = "stacked"
    HALVES = "halves"
    GRID = "grid"
    WIDE = "wide"


class Cell(NamedTuple):
    """Cell of a table: its text, note and tone."""

    text: str
    note: str = ""
    tone: Tone = Tone.PLAIN
    badge: bool = False
    swatch: str = ""
    hint: str = ""
    mark: bool | None = None


@dataclass(frozen=True)
class Table:
    """Table of a report."""

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
        """Rows of each table in the page: two halves in the layout HALVES, the first the longer."""
        middle = -(-len(self.rows) // 2) if self.layout is TableLayout.HALVES else len(self.rows)
        return [rows for rows in (self.cells[:middle], self.cells[middle:]) if rows] or [[]]

    def markdown(self) -> str:
        """Table in Markdown, without notes and tones."""
        rows = [[cell.text for cell in row] for row in self.cells]
        lines = ["| " + " | ".join(row) + " |" for row in ([*self.header], *rows)]
        return "\n".join([lines[0], "|" + "---|" * len(self.header), *lines[1:]])

    def _cell(self, cell: str | bool | Cell) -> Cell:
        if isinstance(cell, bool):
            return Cell(self.marks[not cell], mark=cell)
        return Cell(cell) if isinstance(cell, str) else cell


@dataclass(frozen=True)
class Note:
    """Paragraph of a report, with a heading before it where there is one."""

    text: str
    head: str = ""
    warning: bool = False
    kind: ClassVar[str] = "note"

    def markdown(self) -> str:
        """Paragraph in Markdown."""
        return f"**{self.head}** {self.text}" if self.head else self.text


@dataclass(frozen=True)
class Lines:
    """Lines of a report, as a list or as code."""

    lines: Sequence[str]
    beside: Sequence[str] = ()
    bullets: bool = False
    title: str = ""
    kind: ClassVar[str] = "lines"

    def markdown(self) -> str:
        """Lines in Markdown: a list with `bullets`, else a block of code."""
        head = f"### {self.title}\n\n" if self.title else ""
        return head + "\n".join(("- " if self.bullets else "    ") + line for line in (*self.lines, *self.beside))


@dataclass(frozen=True)
class Fragment:
    """Piece of HTML in a report's page."""

    html: str
    kind: ClassVar[str] = "fragment"

    def markdown(self) -> str:
        """Empty text: a piece that is HTML alone is not in a recording."""
        return ""


# What a section of a report holds; a text is a paragraph.
Part: TypeAlias = str | Note | Lines | Table | Drawing | Fragment


@dataclass(frozen=True)
class Section:
    """Section of a report: its title and parts."""

    title: str
    parts: Sequence[Part]
    badge: Cell | None = None
    name: str = ""


@dataclass(frozen=True)
class Report:
    """Report of a result: title, outcome, facts and sections."""

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
        """Figures of all sections, in their order."""
        return [part for section in self.sections for part in section.parts if isinstance(part, Drawing)]

    def html(self, figures: Mapping[str, Path]) -> str:
        """Page that needs no other file, with the figures' PNG files in it."""
        return rendered("page.html", HOME, report=self, figures=png_urls(figures), narrow={})

    def markdown(self, *parts: Part) -> str:
        """Text in Markdown for a recording: the outcome, and parts, or facts and all sections."""
        given = parts or (answers_table(self.facts), *_of_sections(self.sections))
        warning = () if self.complete else (f"**{self.incomplete}**",)
        texts = (part if isinstance(part, str) else part.markdown() for part in given if not isinstance(part, Drawing))
        return "\n\n".join(filter(None, (*warning, self.outcome, *texts))) + "\n"

    def record(self, path: str | Path, figures: Mapping[str, Path]) -> None:
        """Write a recording of the text beside the pictures."""
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
        figures: bool = True,
    ) -> Path:
        """Write the report's folder, all or none: summary, tables, recording, page, and figures as PNG files."""
        with all_or_none(folder, last=name) as beside:
            progress("summary", 0.0)
            if summary is not None:
                write_json(beside / name, summary)
            for table, write in (tables or {}).items():
                write(beside / table)
            progress("figures", 0.1)
            files = write_drawings(made_folder(beside / FIGURES), self.drawings) if figures else {}
            progress("recording", 0.7)
            (record or self.record)(beside / RECORDING, files)
            progress("report", 0.95)
            urls = png_urls(files) if figures else data_urls(self.drawings)
            narrow = {} if figures else narrow_urls(self.drawings)
            write_text(beside / REPORT, rendered("page.html", HOME, report=self, figures=urls, narrow=narrow))
            progress("report", 1.0)
        return Path(folder)


def _of_sections(sections: Iterable[Section]) -> Iterator[Part]:
    for section in sections:
        if section.title:
            yield f"## {section.title}"
        yield from section.parts


def answers_table(facts: Sequence[Fact]) -> Table:
    """Table of facts, two questions and answers in each row, for a recording's text."""
    cells = [cell for fact in facts for cell in (fact.question, f"**{fact.answer}**")]
    cells += ["", ""] * (len(facts) % 2)
    rows = [cells[i : i + 4] for i in range(0, len(cells), 4)]
    return Table(rows[0], rows[1:]) if rows else Table((), ())


def settings_section(settings: Iterable[Any], *more: Part) -> Section:
    """Section with an experiment's settings as a table, and more parts."""
    rows = [(setting.name, setting.value, setting.meaning) for setting in settings]
    table = Table(("setting", "value", "meaning"), rows, align="cll", layout=TableLayout.STACKED)
    return Section("Settings", (table, *more))


def files_section(
    recording: str,
    summary: str,
    tables: Mapping[str, str] | None = None,
    name: str = SUMMARY,
    figures: bool = True,
) -> Section:
    """Section on the files beside the report."""
    rows = [
        (RECORDING, f"{recording} Open it with: rerun {RECORDING}; the viewer is installed with adaptctl."),
        (name, summary),
        *(
            (file, f'{meaning} Read it with pyarrow.parquet.read_table("{file}").')
            for file, meaning in (tables or {}).items()
        ),
        *([(f"{FIGURES}/", "The figures of this report as PNG.")] if figures else ()),
    ]
    table = Table(("file", "contents"), rows, align="cl", layout=TableLayout.STACKED)
    return Section("Output files", (table,))


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
    """HTML made from a Jinja template of a package."""
    return _environment(package).get_template(template).render(**content)
