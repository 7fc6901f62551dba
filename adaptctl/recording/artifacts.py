"""Files of an experiment's folder: a comparison written into it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.files import cleaned_of_the_dead, name_beside, reason, require_place
from adaptctl.folders import made_folder
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Progress, Result, silent
from adaptctl.recording.wording import facts, headline, outcome_words

RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)
STAGED = "artifacts"
"""Name of the hidden folder that files are written to before they are moved to their places."""


def shown(comparison: Comparison) -> Result:
    """The `Result` of an experiment, as the command line shows it, made from the `comparison` of its runs: whether it
    is complete, and headline, facts and verdict in words. Its `write(folder, progress)` writes its files (recording,
    summary, trace, figures, report) by `write_artifacts`. Its `failed` is False: whether the adaptive controller did
    what was asked is in its `verdict.passed`. Raises `ValueError` for a first run of another number of joints than
    there are torque limits."""
    return Result(
        complete=comparison.complete,
        headline=headline(outcome_words(comparison), comparison.complete),
        facts=tuple(facts(comparison)),
        verdict=judged(comparison),
        write=lambda folder, progress: write_artifacts(folder, comparison, progress),
    )


def write_artifacts(folder: str | Path, comparison: Comparison, progress: Progress = silent) -> Path:
    """Write the files of a `comparison` of runs into a `folder`, which is made where it is missing, and return its
    path. The files are recording.rrd (for the rerun viewer), summary.json, trace.parquet (all samples of the
    comparison's first run), report.html, and PNG files of figures in the subfolder `figures`.

    Either all are written, each over an existing file of its name, or none, where one cannot be written or `progress`
    raises. `progress(what, share)` is called with the name of the file being written and the fraction of the work that
    is done, 0 to 1; the default does nothing. Of a run whose numbers overflowed to NaN or infinity, the report and the
    summary say so: its numbers in the summary are null, findings too, and its recording ends before them.

    Raises `FileError` where a file cannot be written or the folder cannot be made; `InputError` for a basis of another
    mechanism, and `NonFiniteError`, a subclass of it, for a run whose first positions are NaN or infinite.
    """
    from adaptctl.recording.figures import write_figures
    from adaptctl.recording.report import write_report
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.summary import write_summary
    from adaptctl.recording.trace import write_trace

    with _all_or_none(Path(folder)) as beside:
        progress("summary", 0.0)
        write_summary(beside / SUMMARY, comparison)
        write_trace(beside / TRACE, comparison)
        progress("recording", 0.1)
        write_recording(beside / RECORDING, comparison)
        progress("figures", 0.3)
        figures = write_figures(beside / FIGURES, comparison)
        progress("report", 0.95)
        write_report(beside / REPORT, comparison, figures)
        progress("report", 1.0)
    return Path(folder)


@contextmanager
def _all_or_none(path: Path) -> Iterator[Path]:
    """A folder within `path`, which is made where it is missing, to write to: when the block ends its files are moved
    into `path`; when it fails `path` stays as it was."""
    made: list[Path] = []
    cleaned_of_the_dead(path, STAGED)
    beside = name_beside(path / STAGED)
    try:
        for place in (path, path / FIGURES, beside / FIGURES):
            made += _made(place)
        yield beside
        _move_in(beside, path)
    except FileError as error:
        raise FileError(str(error).replace(str(beside), str(path))) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
        for place in reversed(made):
            with suppress(OSError):  # It holds files, unless the block has failed.
                place.rmdir()


def _made(place: Path) -> list[Path]:
    """The folder, which is there now, if it was not before; else none. Raises `FileError` where it cannot be made."""
    made = [] if place.is_dir() else [place]
    made_folder(place)
    return made


def _move_in(beside: Path, path: Path) -> None:
    """Each file into its place, the summary last: what is half done does not say that it is complete."""
    files = [file for file in beside.rglob("*") if file.is_file()]
    places = [(file, require_place(path / file.relative_to(beside))) for file in files]
    for file, place in sorted(places, key=lambda one: one[0].name == SUMMARY):
        try:
            shutil.move(file, place)
        except OSError as error:
            raise FileError(f"{place}: cannot be written ({reason(error)})") from error
