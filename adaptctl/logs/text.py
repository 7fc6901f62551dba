"""Reader of logs as text."""

from __future__ import annotations

import codecs
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from adaptctl.errors import FileError, printable
from adaptctl.logs import on_disk
from adaptctl.logs.arrow import EXACT, LogColumn, numbers
from adaptctl.logs.batches import Batches, UnlikeBeforeError
from adaptctl.logs.table import LogTable, table, validate_size, whole_stamps
from adaptctl.logs.text_columns import text_column
from adaptctl.logs.text_form import COMMENT, TextForm, form_of

MAX_SPACED = 2**30
"""bytes of a file with blanks between its numbers, or with repeated names, which is rewritten in memory"""
EMPTY = ("", "NA", "N/A", "#N/A", "null", "NULL", "None", "none", "nan", "NaN", "NAN", "-nan", "-NaN")
MAX_ODD, MAX_CHANGES = 10_000, 4
"""lines of another length than the others, and readings of a file whose columns turn out to be texts"""
BLOCK = 2**20
"""bytes of a file that are read at a time"""
BLANKS = re.compile("[ \t]+")
CHANGED = re.compile(r"In CSV column #(\d+): .*conversion error")


def read_delimited(path: str | Path) -> LogTable:
    """Table of a text file: names, perhaps, then rows of numbers, separated by commas, semicolons, tabs or blanks."""
    try:
        form = form_of(path)
        with _quiet_where_undecodable():
            found, notes = _long(path, form) or _read(path, form)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not a text table ({error})") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from error
    units = form.units | {one.name: one.unit for one in found if one.unit}
    empty = {one.name: one.empty for one in found if one.empty is not None}
    begin = {one.name: one.begin for one in found if one.begin}
    words = {one.name: one.word for one in found if one.word is not None}
    log = table(str(path), ((one.name, one.values) for one in found), units, empty, words, begin)
    return whole_stamps(replace(log, numbered=form.names is None, notes=(*form.notes, *notes, *log.notes)))


@contextmanager
def _quiet_where_undecodable() -> Iterator[None]:
    """Context manager in which Arrow prints no trace of a line that is no text, which it refuses besides."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda raised: None if raised.exc_type is UnicodeDecodeError else before(raised)
    try:
        yield
    finally:
        sys.unraisablehook = before


def _read(path: str | Path, form: TextForm) -> tuple[list[LogColumn], list[str]]:
    """Columns of a file, read at once, and notes on lines left out."""
    read, odd = _parsed(path, form, _source(path, form))
    notes: list[str] = []
    if form.names is not None and any(_is_in(n, read.column(i)) for i, n in enumerate(form.names[: read.num_columns])):
        source, count = _rewritten(path, form)
        read, odd = _parsed(path, form, source)
        notes = [f"{count} lines that repeat those above the numbers were left out"]
    notes += _passed_over(path, form, odd)
    validate_size(path, read.num_rows, read.num_columns)
    names = form.names or [str(i + 1) for i in range(read.num_columns)]
    return [text_column(name, read.column(i), form.decimal) for i, name in enumerate(names)], notes


def _long(path: str | Path, form: TextForm) -> tuple[list[LogColumn], list[str]] | None:
    """Columns of a large file, read batch by batch, and notes; None of others, and where many columns change kind."""
    from pyarrow import ArrowException

    if Path(path).stat().st_size < on_disk.LARGE:
        return None
    if form.mark == " ":
        with TemporaryDirectory() as folder:
            other = _with_tabs(path, form, Path(folder))
            try:
                return _long(other, replace(form, mark="\t", encoding="utf-8"))
            except FileError as error:
                raise FileError(str(error).replace(str(other), str(path))) from error
    with suppress(ArrowException, UnlikeBeforeError):
        kinds = _kinds(path, form)
        for _ in range(MAX_CHANGES):
            odd: list[tuple[int, str]] = []
            try:
                read = _in_batches(path, form, kinds, odd)
            except ArrowException as error:
                kinds[_changed(str(error), list(kinds))] = None
                continue
            notes = _passed_over(path, form, odd)
            return [one._replace(name=name) for name, one in _with_texts(path, form, kinds, read)], notes
    return None


def _kinds(path: str | Path, form: TextForm) -> dict[str, Any]:
    """Types of a file's columns by Arrow's names of them, None of texts; whole numbers may have a point later."""
    with _stream(path, form, []) as stream:
        first = stream.read_next_batch()
    names = first.schema.names
    if len(set(names)) < len(names) or any(map(_is_in, names, first.columns)):
        raise UnlikeBeforeError
    return {name: _kind(column) for name, column in zip(names, first.columns, strict=True)}


def _kind(column: Any) -> Any:
    import pyarrow as pa
    from pyarrow import compute

    kind = column.type
    if pa.types.is_string(kind) or pa.types.is_time(kind):
        return None
    if pa.types.is_integer(kind):
        ends = (end.as_py() or 0 for end in compute.min_max(column).values())
        return kind if max(map(abs, ends)) >= EXACT else pa.float64()
    return pa.float64() if pa.types.is_null(kind) else kind


def _in_batches(path: str | Path, form: TextForm, kinds: dict[str, Any], odd: list[tuple[int, str]]) -> list[LogColumn]:
    """Columns of a file that have a kind, and lines of another length."""
    read = Batches(Path(path).stat().st_size // (2 * form.count) + 2)
    with _stream(path, form, odd, {name: kind for name, kind in kinds.items() if kind is not None}) as stream:
        for batch in stream:
            validate_size(path, read.rows + len(batch), len(kinds))
            each = zip(batch.schema.names, batch.columns, strict=True)
            read.add((one for name, own in each for one in numbers(name, own, first=read.first(name))), len(batch))
    return read.columns()


def _changed(message: str, names: Sequence[str]) -> str:
    """Name of the column of which Arrow says that its cells are of another kind."""
    found = CHANGED.search(message)
    if found is None or int(found[1]) >= len(names):
        raise UnlikeBeforeError
    return names[int(found[1])]


def _with_texts(
    path: str | Path, form: TextForm, kinds: dict[str, Any], read: Sequence[LogColumn]
) -> Iterator[tuple[str, LogColumn]]:
    """Columns of a file by name: those that were read, and those of texts, one after the other."""
    found = {one.name: one for one in read}
    for i, name in enumerate(kinds):
        own = str(i + 1) if form.names is None else name
        if name in found:
            yield own, found[name]
        else:
            texts, _ = _parsed(path, form, path, [name])
            if _is_in(name, texts.column(0)):
                raise UnlikeBeforeError
            yield own, text_column(own, texts.column(0), form.decimal)


def _is_in(name: str, column: Any) -> bool:
    """True if a cell of a column is its name."""
    import pyarrow as pa
    from pyarrow import compute

    return bool(pa.types.is_string(column.type) and compute.index(column, name).as_py() >= 0)


def _options(form: TextForm, odd: list[tuple[int, str]], kinds: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Options of Arrow's readers, of some columns or all; lines of another length are noted."""
    from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions

    def is_passed_over(row: Any) -> str:
        odd.append((row.actual_columns, row.text))
        return "skip" if len(odd) < MAX_ODD else "error"

    reading = ReadOptions(
        skip_rows=form.skipped,
        column_names=form.names,
        autogenerate_column_names=form.names is None,
        block_size=BLOCK,
        encoding="utf8" if form.encoding == "utf-8-sig" else form.encoding,
    )
    parsing = ParseOptions(delimiter="\t" if form.mark == " " else form.mark, invalid_row_handler=is_passed_over)
    converting = ConvertOptions(
        strings_can_be_null=True,
        null_values=list(EMPTY),
        decimal_point=form.decimal,
        column_types=kinds,
        include_columns=list(names),
    )
    return {"read_options": reading, "parse_options": parsing, "convert_options": converting}


def _stream(path: str | Path, form: TextForm, odd: list[tuple[int, str]], kinds: dict[str, Any] | None = None) -> Any:
    from pyarrow.csv import open_csv

    return open_csv(_source(path, form), **_options(form, odd, kinds or {}, list(kinds or ())))


def _parsed(
    path: str | Path, form: TextForm, source: Any, names: Sequence[str] = ()
) -> tuple[Any, list[tuple[int, str]]]:
    """Columns of a file, all or some, and lines of another length with their numbers of cells."""
    from pyarrow import ArrowInvalid, default_memory_pool
    from pyarrow.csv import read_csv

    odd: list[tuple[int, str]] = []
    try:
        read = read_csv(source, **_options(form, odd, {}, names))
    except ArrowInvalid as error:
        if "Empty CSV" in str(error):
            raise FileError(
                f"{path}: no rows of numbers; expected a line of column names and one line per sample"
            ) from error
        raise FileError(f"{path}: not a text table ({printable(str(error).splitlines()[0])})") from error
    default_memory_pool().release_unused()  # several times the numbers, of text that has been read
    return read, odd


def _source(path: str | Path, form: TextForm) -> Any:
    """File, or its content: without half a character at the end, and with one tab for the blanks between numbers."""
    import pyarrow as pa

    if form.mark == " ":
        return _rewritten(path, replace(form, heads=()))[0]
    size = Path(path).stat().st_size
    if form.encoding == "utf-16" and size % 2:
        return pa.BufferReader(pa.memory_map(str(path)).read_buffer(size - 1))
    return path


def _with_tabs(path: str | Path, form: TextForm, folder: Path) -> Path:
    """File in a folder with one tab for the blanks between numbers, under the same name."""
    other = folder / Path(path).name
    with Path(path).open(encoding=form.encoding) as lines, other.open("w", encoding="utf-8") as file:
        file.writelines("\t".join(filter(None, BLANKS.split(line.rstrip("\n")))) + "\n" for line in lines)
    return other


def _rewritten(path: str | Path, form: TextForm) -> tuple[BytesIO, int]:
    """File with one tab for the blanks between numbers, and without lines that repeat its heads; their count."""
    if Path(path).stat().st_size > MAX_SPACED:
        raise FileError(f"{path}: more than {MAX_SPACED} bytes, which have to be rewritten; use commas, or split it")
    text = codecs.getincrementaldecoder(form.encoding)().decode(Path(path).read_bytes())
    lines = re.split("\r\n|\r|\n", text)
    kept = [line for i, line in enumerate(lines) if i < form.skipped or line.strip() not in form.heads]
    text = "\n".join(kept)
    if form.mark == " ":
        text = BLANKS.sub("\t", re.sub(r"^[ \t]+|[ \t]+$", "", text, flags=re.MULTILINE))
    return BytesIO(text.encode(form.encoding)), len(lines) - len(kept)


def _passed_over(path: str | Path, form: TextForm, odd: list[tuple[int, str]]) -> list[str]:
    """Notes on comments and a last line that was cut off; `FileError` for other lines of another length."""
    comments = [text for _, text in odd if COMMENT.match(text)]
    others = [(count, text) for count, text in odd if not COMMENT.match(text)]
    notes = [f"{len(comments)} lines of comments left out"] if comments else []
    if not others:
        return notes
    count, text = others[0]
    first, *more = text.splitlines()
    number, last = _place(path, form, first)
    if len(others) == 1 and count < form.count and last and not more:
        return [*notes, "the last line, which is cut off, was left out"]
    why = "opens a quotation mark that is not closed" if more else f"has {count} cells, not {form.count}"
    raise FileError(f"{path}: not a text table (line {number} {why}: {printable(repr(first[:60]))})")


def _place(path: str | Path, form: TextForm, text: str) -> tuple[int | str, bool]:
    """Number of the first line among the rows that reads so, and whether the file ends with it."""
    number: int | str = "?"
    with Path(path).open(encoding=form.encoding, errors="ignore") as file:
        for i, line in enumerate(file, 1):
            if number != "?" and line.strip():
                return number, False
            if i > form.skipped and number == "?" and line.split() == text.split():
                number = i
    return number, number != "?"
