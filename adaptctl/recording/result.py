"""Results of experiments: the outcome in words, and the function that writes the folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from adaptctl.errors import FileError
from adaptctl.files import name_beside, reason, remove_stale_temporaries, validate_place
from adaptctl.folders import made_folder


class Whose(Enum):
    """Enumeration of what a fact in an experiment's report is about, by which the report colours it. SUBJECT is the
    simulated run that a comparison examines, BASELINE the run with adaptation off, NOBODY no single run. The value is
    the name of the report's style: "subject", "off" or, for no colour, empty."""

    SUBJECT = "subject"
    BASELINE = "off"
    NOBODY = ""


class Fact(NamedTuple):
    """A fact about an experiment's result: `question`, one that a person asks first; `answer`, in words, with its unit;
    and `whose`, the run that it is about, `Whose.NOBODY` (no run by itself) unless given. Nothing is checked at
    construction."""

    question: str
    answer: str
    whose: Whose = Whose.NOBODY


def answers(facts: Iterable[Fact]) -> dict[str, str]:
    """Mapping of questions to answers, both texts, of the facts about an experiment's result, in their order; of facts
    with one question, the last counts. Nothing is raised."""
    return {fact.question: fact.answer for fact in facts}


class Failure(Enum):
    """Enumeration of the kinds of a controller's failure in an experiment; the value is a word for it, such as
    "diverged". STOPPED: the environment ended the run early, a joint's position error having passed its bound, or the
    mechanism having come near a singularity of its kinematic loops or broken a condition that its file states.
    DIVERGED: a position error was 1 rad (1 m if prismatic) or more in the run's last 2 s. SATURATED: a torque was at
    its limit for over 2 s in all. NO_BETTER: the RMS position error over the last 2 s is not below 0.9 times that with
    adaptation off. DIFFERS: a build of exported code does not compile, or does not repeat Python's torques within its
    tolerance."""

    STOPPED = "stopped"
    DIVERGED = "diverged"
    SATURATED = "saturated"
    NO_BETTER = "no better"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Fault:
    """A failure of a controller in a run: `failure`, its kind, and `sentence`, a description of it for readers.
    `expected` is the reason why the experiment expects it, so that it does not count against the controller, None, the
    default, where it does not. Nothing is checked at construction."""

    failure: Failure
    sentence: str
    expected: str | None = None


@dataclass(frozen=True)
class Verdict:
    """Verdict on the controllers that an experiment is about: `faults`, their failures in the order found, empty, the
    default, where they did what was asked. Nothing is checked at construction."""

    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, found: Iterable[tuple[Failure, str]], expected: Mapping[Failure, str] | None = None) -> Verdict:
        """The verdict with a `Fault` (a failure of a controller) for each pair of `found`, a kind of failure and a
        sentence about it, in their order. `expected` maps kinds of failure to the reason why the experiment expects
        them, None, the default, for none; a kind that is not in it counts against the controller. Nothing is
        checked."""
        reasons = expected or {}
        return cls(tuple(Fault(failure, sentence, reasons.get(failure)) for failure, sentence in found))

    @classmethod
    def together(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """One verdict made of several, for an experiment about several controllers: the faults (failures) of all of
        them, in their order. Nothing is checked."""
        return cls(tuple(fault for verdict in verdicts for fault in verdict.faults))

    @property
    def passed(self) -> bool:
        """True where the verdict has no faults (failures of a controller), or only such as the experiment expects."""
        return all(fault.expected is not None for fault in self.faults)

    def before(self, answer: str) -> str:
        """The text `answer`, an experiment's result in words, together with sentences on the verdict's faults. Before
        it stand "Failed:" and the unexpected ones; after it each expected one, as "As expected (reason): ...", or
        without the brackets where the reason is empty. Without faults it is the answer alone. Nothing is raised."""
        failed = [fault.sentence for fault in self.faults if fault.expected is None]
        reasons = [(fault, f" ({fault.expected})" if fault.expected else "") for fault in self.faults]
        expected = [f"As expected{why}: {fault.sentence}" for fault, why in reasons if fault.expected is not None]
        return " ".join([*(["Failed:", *failed] if failed else []), answer, *expected])

    def as_builtins(self) -> dict[str, Any]:
        """The verdict in JSON's types: `passed`, a bool, and `faults`, a list of mappings with `failure`, a value of
        `Failure` such as "diverged", `sentence`, a text, and `expected`, the reason or None. Nothing is raised."""
        faults = [
            {"failure": fault.failure.value, "sentence": fault.sentence, "expected": fault.expected}
            for fault in self.faults
        ]
        return {"passed": self.passed, "faults": faults}


RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)
STAGED = "artifacts"
"""Name of the hidden folder that files are written to before they are moved to their places."""


Progress: TypeAlias = Callable[[str, float], object]
"""Called with what is being done, and the fraction of it (0 to 1) that is done."""


def silent(what: str, share: float) -> None:
    """Progress callback that does nothing, for callers that want no progress shown. Its arguments are those of every
    such callback: `what` is being done, in words, and the fraction of it that is done, `share`, 0 to 1. Nothing is
    raised."""


@contextmanager
def all_or_none(folder: str | Path, last: str = SUMMARY) -> Iterator[Path]:
    """Context manager that gives a hidden folder within `folder`, which is made where it is missing, to write to: when
    the block ends its files are moved into `folder`, over existing ones of their names, the file `last` after all
    others, so that what is half done does not say that it is complete; when the block fails `folder` stays as it was.
    Raises `FileError`, which names the file's own place, where one cannot be written or the folder cannot be made."""
    path, made = Path(folder), list[Path]()
    remove_stale_temporaries(path, STAGED)
    beside = name_beside(path / STAGED)
    try:
        made += _made(path)
        made_folder(beside)
        yield beside
        for place in beside.rglob("*"):
            made += _made(path / place.relative_to(beside)) if place.is_dir() else []
        _move_in(beside, path, last)
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


def _move_in(beside: Path, path: Path, last: str) -> None:
    files = [file for file in beside.rglob("*") if file.is_file()]
    places = [(file, validate_place(path / file.relative_to(beside))) for file in files]
    for file, place in sorted(places, key=lambda one: one[0].name == last):
        try:
            shutil.move(file, place)
        except OSError as error:
            raise FileError(f"{place}: cannot be written ({reason(error)})") from error


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a finished experiment, as the command line prints and saves it.

    `complete` is False where the experiment was interrupted: the result then holds what was computed. `headline` is the
    outcome in a sentence or two; `facts` are the questions that a person asks first, with their answers; `verdict` has
    the failures of the controllers that the experiment is about, by which the command's exit code is decided.
    `write(folder, progress)` writes recording, report and figures into an existing folder, and calls `progress(what,
    share)` with what is being written and the fraction done, 0 to 1. `failed` is True where the experiment itself
    counts its controller as failed; False, the default, for most experiments, whose failures are in `verdict` alone.
    Nothing is checked at construction.
    """

    complete: bool
    headline: str
    facts: tuple[Fact, ...]
    verdict: Verdict
    write: Callable[[Path, Progress], object]
    failed: bool = False
