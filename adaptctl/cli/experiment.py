"""`adaptctl experiment`: list experiments, run one, keep what it made."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from adaptctl.cli.compiling import Announcement
from adaptctl.cli.heartbeat import heartbeat
from adaptctl.cli.idle_flags import idle_flags
from adaptctl.cli.interruption import Interruption, interruptible
from adaptctl.cli.memory import return_large_blocks
from adaptctl.cli.numbers import plain_numbers
from adaptctl.cli.output import Json, WrappedTable, print_json, print_outcome, print_parts
from adaptctl.cli.settings_file import filled_in
from adaptctl.errors import InputError
from adaptctl.experiments import EXPERIMENTS, RENAMED, find, from_entry_point, from_file, offered
from adaptctl.stages import watching

if TYPE_CHECKING:
    from adaptctl.experiments.experiment import Experiment
    from adaptctl.recording import Result

CONFIG = "TOML file or finished run's folder with settings; flags take precedence."
DONE, FAILED, INTERRUPTED = 0, 3, 130
LIST_SCHEMA, RUN_SCHEMA = "adaptctl/experiments/1", "adaptctl/experiment/1"

app = App(name="experiment")
run = App(name="run", help="Run an experiment, and write its results.", config=(filled_in, plain_numbers, idle_flags))
app.command(run)
for entry in EXPERIMENTS:
    run.command(f"{__name__}:{entry.name}", name=entry.name, help=f"{entry.summary}.")


@app.command(name="list")
def list_experiments(*, json: Json = False) -> None:
    """
    Print the names of the experiments, with a line about each.

    Experiments of installed packages come last, with the object that defines
    them. With `json` an object with `experiments`, a list of `name` and
    `summary`, is printed.
    """
    summaries = [(entry.name, entry.summary) for entry in EXPERIMENTS]
    summaries += [(name, f"from {point.value}") for name, point in offered().items()]
    if json:
        entries = [{"name": name, "summary": summary} for name, summary in summaries]
        print_json({"schema": LIST_SCHEMA, "experiments": entries})
        return
    width = max(len(name) for name, _ in summaries)
    for name, summary in summaries:
        print(f"{name:<{width}}  {summary}")


@app.command
def compare(*folders: Path, out: Path | None = None, overwrite: bool = False, json: bool = False) -> None:
    """
    Print how finished experiments differ: settings first, then errors.

    Errors are those of the last 2 s in mrad (mm), each with its ratio to the
    first folder's. Robots may differ where they have controllers in common and
    errors of one unit.

    Parameters
    ----------
    folders : Path
        Two or more results folders.
    out : Path
        Folder to write, with a report that has their curves over each other.
    overwrite : bool
        Overwrite a folder that is not empty.
    json : bool
        Print JSON instead of text, in rad (m).
    """
    from adaptctl.recording.compared_folders import compare_folders

    found = compare_folders(folders)
    if out is not None:
        from adaptctl.folders import replacing_folder
        from adaptctl.recording.compared_report import write_compared

        with replacing_folder(out, overwrite) as folder:
            write_compared(folder, found)
    if json:
        print_json(found.as_builtins())
        return
    settings = WrappedTable(["setting", *found.folders], [[one.name, *one.values] for one in found.differences])
    errors = WrappedTable(["error, last 2 s", *found.folders], [[one.name, *one.words] for one in found.errors])
    print_parts([settings if found.differences else "All settings are the same.", errors])
    if out is not None:
        print(f"\nReport: {out / 'report.html'}")


class RunFormat(Enum):
    """Formats that finished runs are written in."""

    MCAP = "mcap"
    LEROBOT = "lerobot"


@app.command
def convert(*folders: Path, to: RunFormat, out: Path | None = None) -> None:
    """
    Write finished runs for other tools: MCAP with a Foxglove layout, or a LeRobot data set.

    Parameters
    ----------
    folders : Path
        Results folders.
    to : RunFormat
        mcap for recording.mcap and foxglove.json in each folder; lerobot for
        one data set (v3.0) of runs of one robot, an episode each.
    out : Path
        New folder of the data set.
    """
    from adaptctl.recording.finished_trace import read_traces

    traces = read_traces(folders)
    if not traces:
        raise InputError("expected at least one results folder")
    if to is RunFormat.MCAP:
        from adaptctl.recording.mcap_file import LAYOUT, MCAP, write_layout, write_mcap

        if out is not None:
            raise InputError("--out: MCAP is written beside each recording; leave it out")
        for folder, trace in zip(folders, traces, strict=True):
            write_mcap(folder / MCAP, trace)
            write_layout(folder / LAYOUT, trace)
            print(f"{folder / MCAP}, shown with the layout {folder / LAYOUT}")
        return
    from adaptctl.folders import replacing_folder
    from adaptctl.recording.lerobot_set import write_lerobot

    if out is None:
        raise InputError("--out: expected the folder of the data set")
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"--out: {out} is not empty; choose another folder")
    with replacing_folder(out) as place:
        write_lerobot(place, traces)
    print(f"{out}: {len(traces)} episodes")


def offer_own(given: Sequence[str]) -> None:
    """Register the experiment of a Python file or a package that the command line names."""
    name = given[2] if list(given[:2]) == ["experiment", "run"] and len(given) > 2 else "-"
    if name.startswith("-") or name in (entry.name for entry in EXPERIMENTS):
        return
    if name in RENAMED:
        find(name)
    if name.endswith(".py"):
        kind = from_file(name)
    elif (point := offered().get(name)) is not None:
        kind = from_entry_point(point)
    else:
        return
    run.command(_command(kind, kind.name), name=name, help=f"{kind.title}.")


def __getattr__(name: str) -> Callable[..., int]:
    """Command that runs the experiment of that name, which is imported only now."""
    if name not in (entry.name for entry in EXPERIMENTS):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _command(find(name), name)


def _command(kind: type[Experiment], name: str) -> Callable[..., int]:
    from adaptctl.experiments.experiment import text

    try:
        default = kind()
    except TypeError as error:
        raise InputError(f"experiment {name!r}: every setting needs a default: {error}") from error

    def command(
        *,
        settings: Any = default,
        config: Path | None = None,
        out: Path = Path("results") / name,
        overwrite: bool = False,
        figures: bool = False,
        json: bool = False,
        live: bool = False,
    ) -> int:
        from adaptctl.recording.live import HOST, PORT, streaming

        with streaming(f"{HOST}:{PORT}" if live else None):
            return run_experiment(settings, out, overwrite, json, figures)

    command.__annotations__ = {
        "settings": Annotated[kind, Parameter(name="*", group="Settings", show_default=text)],
        "config": Annotated[Path | None, Parameter(metavar="PATH", group="Settings", help=CONFIG)],
        "out": Annotated[Path, Parameter(metavar="DIR", group="Output", help="Folder to write.")],
        "overwrite": Annotated[bool, Parameter(group="Output", help="Overwrite a folder that is not empty.")],
        "figures": Annotated[
            bool, Parameter(group="Output", help="Also write the report's figures as PNG, PDF and SVG.")
        ],
        "live": Annotated[bool, Parameter(group="Output", help="Show the arm in the rerun viewer during the run.")],
        "json": Annotated[bool, Parameter(group="Output", help="Print JSON instead of text.")],
        "return": int,
    }
    return command


def run_experiment(
    experiment: Experiment, out: Path, overwrite: bool, json: bool = False, figures: bool = False
) -> int:
    """
    Run an experiment, write its results and print them.

    Parameters
    ----------
    experiment : Experiment
        Experiment with its settings.
    out : Path
        Folder of the results, whole or not at all.
    overwrite : bool
        Replaces an older run in the folder.
    json : bool, default False
        Prints a JSON object.
    figures : bool, default False
        Also writes the report's figures as PNG, PDF and SVG files.

    Returns
    -------
    int
        Exit code: 0, 3 for a failed verdict, 130 after an interruption, with what was computed.

    Raises
    ------
    FileError
        If the folder is not empty, cannot be written, or another run writes it.
    """
    from adaptctl.folders import replacing_folder
    from adaptctl.optional_packages import validate_for_results

    validate_for_results()
    return_large_blocks()
    with notes_last():
        with interruptible() as interruption, replacing_folder(out, overwrite) as folder:
            result = _computed(experiment, folder, interruption, figures)
            interruption.hold()
        if json:
            print_json(as_builtins(experiment.name, result, out))
        else:
            print_outcome(result.headline, result.facts, out)
        print(end="", flush=True)
    if interruption.asked or not result.complete:
        return INTERRUPTED
    return DONE if result.verdict.passed else FAILED


def as_builtins(name: str, result: Result, folder: Path) -> dict[str, Any]:
    """Result of an experiment in JSON's types; numbers are in its summary.json."""
    from adaptctl.recording.result import answers

    return {
        "schema": RUN_SCHEMA,
        "experiment": name,
        "complete": result.complete,
        "verdict": result.verdict.as_builtins(),
        "headline": result.headline,
        "facts": answers(result.facts),
        "folder": str(folder),
    }


@contextmanager
def notes_last() -> Iterator[None]:
    """Context manager that shows warnings at its end, below the printed output."""
    kept: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as kept:
            yield
    finally:
        for one in kept:
            warnings.showwarning(one.message, one.category, one.filename, one.lineno)


def _computed(experiment: Experiment, folder: Path, interruption: Interruption, figures: bool) -> Result:
    """Result of an experiment, computed and written, with progress on stderr."""
    with shown_progress() as progress:
        result = experiment.run(interruption.heeded(progress))
        interruption.hold()
        if not result.complete:
            print("adaptctl: interrupted; writing what was computed", file=sys.stderr)
        result.write(folder, lambda what, share: progress("Recording and report", share))
        if figures and result.figures is not None:
            from adaptctl.recording.result import FIGURES

            result.figures(folder / FIGURES)
    return result


@contextmanager
def shown_progress() -> Iterator[Callable[[str, float], None]]:
    """Context manager that shows a bar for each stage on stderr; lines tell of it where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console, left = Console(stderr=True), TimeRemainingColumn(compact=True, elapsed_when_finished=True)
    with Progress(*columns, left, console=console, disable=not console.is_terminal) as shown:
        tasks: dict[str, TaskID] = {}

        def progress(what: str, share: float) -> None:
            if what not in tasks:
                tasks[what] = shown.add_task(what, total=1.0)
            shown.update(tasks[what], completed=share)
            heartbeat.doing(f"{what}, {share:.0%}")

        compiling = shown.add_task("Compiling", total=None, visible=False)
        watcher = Announcement(
            lambda: shown.update(compiling, visible=True), lambda: shown.update(compiling, visible=False)
        )
        try:
            with watching(watcher) if console.is_terminal else nullcontext():
                yield progress
        except BaseException:
            shown.live.transient = True  # what went wrong is one line, with no half-filled bars above it
            raise
