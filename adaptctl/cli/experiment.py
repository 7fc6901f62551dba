"""`adaptctl experiment`: list experiments, run one, keep what it made."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import Field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptctl.cli.interruption import Interruption, interruptible
from adaptctl.experiments import EXPERIMENTS, Entry, find

if TYPE_CHECKING:
    from adaptctl.experiments.experiment import Experiment
    from adaptctl.recording import Result

DONE, INTERRUPTED = 0, 130
NOT_SETTINGS = ("name", "out", "overwrite", "run")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`list`, and `run` with a flag for every setting of the experiment that is named."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="name the experiments", description="The experiments there are.")
    listing.set_defaults(run=list_experiments)
    running = actions.add_parser("run", help="run an experiment", description="Run an experiment.")
    names = running.add_subparsers(title="experiments", metavar="EXPERIMENT", required=True)
    for entry in EXPERIMENTS:
        names.add_parser(entry.name, help=entry.summary, fill=partial(_add_settings, entry))


def run(arguments: argparse.Namespace) -> int:
    """Run the experiment that was named, with its settings, and write its folder."""
    from adaptctl.recording import prepare_folder

    kind = find(arguments.name)
    chosen = {name: value for name, value in vars(arguments).items() if name not in NOT_SETTINGS}
    experiment = kind(**chosen)
    folder = prepare_folder(arguments.out or Path("results") / arguments.name, arguments.overwrite)
    with interruptible() as interruption:
        result = _computed(experiment, folder, interruption)
    _tell(result, folder)
    return DONE if result.complete else INTERRUPTED


def list_experiments(arguments: argparse.Namespace) -> int:
    """Name the experiments, one a line."""
    width = max(len(entry.name) for entry in EXPERIMENTS)
    for entry in EXPERIMENTS:
        print(f"{entry.name:<{width}}  {entry.summary}")
    return DONE


def _add_settings(entry: Entry, parser: argparse.ArgumentParser) -> None:
    """The experiment's fields as flags; only now is it imported."""
    from adaptctl.experiments.experiment import settings

    kind = find(entry.name)
    parser.description = f"{entry.summary}."
    parser.set_defaults(name=entry.name, run=run)
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="DIR", help=f"folder to write (default: results/{entry.name})")
    output.add_argument("--overwrite", action="store_true", help="write into a folder that is not empty")
    chosen = parser.add_argument_group("settings")
    for field in settings(kind):
        chosen.add_argument(f"--{field.name.replace('_', '-')}", **_flag(field))


def _flag(field: Field[Any]) -> dict[str, Any]:
    """What argparse needs to know of a setting."""
    from adaptctl.experiments.experiment import text

    default: Any = field.default
    many = isinstance(default, tuple)
    kind = type(default[0] if many else default)
    metavar = {int: "N", float: "X", str: "NAME"}[kind]
    symbol = f"{field.metadata['symbol']}: " if field.metadata["symbol"] else ""
    described = f"{symbol}{field.metadata['meaning']} (default: {text(default)})".replace("%", "%%")
    flag = {"dest": field.name, "default": default, "metavar": metavar, "help": described, "type": kind}
    return flag | ({"nargs": "+", "action": _Tuple} if many else {})


class _Tuple(argparse.Action):
    """Several numbers after a flag, as a tuple."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        setattr(namespace, self.dest, tuple(values))


def _computed(experiment: Experiment, folder: Path, interruption: Interruption) -> Result:
    """Compute and write, showing how far it is on stderr."""
    with _progress() as told:
        result = experiment.compare(interruption.heeded(told))
        if not result.complete:
            print("adaptctl: interrupted; writing what was computed", file=sys.stderr)
        result.write(folder, lambda what, share: told("Recording, figures and report", share))
    return result


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """A bar a stage on stderr, where that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console = Console(stderr=True)
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal) as shown:
        tasks: dict[str, TaskID] = {}

        def told(what: str, share: float) -> None:
            if what not in tasks:
                tasks[what] = shown.add_task(what, total=1.0)
            shown.update(tasks[what], completed=share)

        try:
            yield told
        except BaseException:
            shown.live.transient = True  # what went wrong is one line, with no half-filled bars above it
            raise


def _tell(result: Result, folder: Path) -> None:
    """The outcome, and where to look, on stdout."""
    print(result.headline())
    answers = list(result.facts())
    width = max(len(question) for question, _ in answers)
    print("\n".join(f"  {question:<{width}}  {answer}" for question, answer in answers))
    print(f"\nLook at it:  rerun {folder / 'recording.rrd'}\nRead it:     {folder / 'report.html'}")
