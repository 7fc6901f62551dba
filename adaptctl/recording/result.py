"""Results of experiments."""

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


class RunRole(Enum):
    """
    Run that a fact describes: the subject, the run with adaptation off, or neither. The report colors the fact by it.

    Examples
    --------
    >>> from adaptctl.recording import RunRole
    >>> RunRole.SUBJECT.value
    'subject'
    """

    SUBJECT = "subject"
    BASELINE = "off"
    NOBODY = ""


class Fact(NamedTuple):
    """
    Question about a result and its answer, shown at the top of a report.

    Parameters
    ----------
    question : str
        Question in words.
    answer : str
        Answer in words, with its unit.
    role : RunRole, optional
        Run that the fact describes, which sets its color in the report. Default: none.

    Examples
    --------
    >>> from adaptctl.recording import Fact
    >>> Fact("Peak torque", "21.7 % of the limit").answer
    '21.7 % of the limit'
    """

    question: str
    answer: str
    role: RunRole = RunRole.NOBODY


def answers(facts: Iterable[Fact]) -> dict[str, str]:
    """Answers by question, in their order."""
    return {fact.question: fact.answer for fact in facts}


class Failure(Enum):
    """
    Kinds of a controller's failure in an experiment.

    Notes
    -----
    - STOPPED: the environment ended the run early, by a position error, a singularity or a broken condition.
    - DIVERGED: a position error was 1 rad (1 m) or more in the last 2 s.
    - SATURATED: a torque was at its limit for over 2 s in all.
    - NO_BETTER: the error of the last 2 s is not below 0.9 times that without adaptation.
    - DIFFERS: exported code does not compile, or does not repeat Python's torques within its tolerance.

    Examples
    --------
    >>> from adaptctl.recording import Failure
    >>> Failure.DIVERGED.value
    'diverged'
    """

    STOPPED = "stopped"
    DIVERGED = "diverged"
    SATURATED = "saturated"
    NO_BETTER = "no better"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Fault:
    """
    Failure of a controller in a run.

    Parameters
    ----------
    failure : Failure
        Kind of failure.
    sentence : str
        Description for readers.
    expected : str, optional
        Reason why the experiment expects it, so that it does not count against the controller.

    Examples
    --------
    >>> from adaptctl.recording import Failure, Fault
    >>> Fault(Failure.SATURATED, "joint 2 was at its limit for 3 s").expected is None
    True
    """

    failure: Failure
    sentence: str
    expected: str | None = None


@dataclass(frozen=True)
class Verdict:
    """
    Verdict of an experiment: the failures of its controllers, or none.

    Parameters
    ----------
    faults : tuple of Fault, optional
        Failures in the order found. Without failures the experiment has passed.

    Examples
    --------
    >>> from adaptctl.recording import Failure, Verdict
    >>> verdict = Verdict.of([(Failure.SATURATED, "Joint 2 was at its limit.")])
    >>> verdict.passed
    False
    >>> verdict.before("The error is 3 mrad.")
    'Failed: Joint 2 was at its limit. The error is 3 mrad.'
    """

    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, found: Iterable[tuple[Failure, str]], expected: Mapping[Failure, str] | None = None) -> Verdict:
        """
        Return the verdict of given failures.

        Parameters
        ----------
        found : iterable of tuple
            Pairs of a failure's kind and a sentence.
        expected : mapping of Failure to str, optional
            Reasons why the experiment expects a kind. Default: none, every failure counts.

        Returns
        -------
        Verdict
            Failures in their order.

        Examples
        --------
        >>> from adaptctl.recording import Failure, Verdict
        >>> found = [(Failure.SATURATED, "Joint 2 was at its limit.")]
        >>> Verdict.of(found, expected={Failure.SATURATED: "Its motor is weak."}).passed
        True
        """
        reasons = expected or {}
        return cls(tuple(Fault(failure, sentence, reasons.get(failure)) for failure, sentence in found))

    @classmethod
    def merge(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """
        Join verdicts on several controllers.

        Parameters
        ----------
        verdicts : iterable of Verdict
            Verdicts in their order.

        Returns
        -------
        Verdict
            All failures.

        Examples
        --------
        >>> from adaptctl.recording import Verdict
        >>> Verdict.merge([Verdict(), Verdict()]).passed
        True
        """
        return cls(tuple(fault for verdict in verdicts for fault in verdict.faults))

    @property
    def passed(self) -> bool:
        """True if there is no failure, or the experiment expects all of them."""
        return all(fault.expected is not None for fault in self.faults)

    def before(self, answer: str) -> str:
        """
        Return an experiment's answer together with sentences on the failures.

        Parameters
        ----------
        answer : str
            Result in words.

        Returns
        -------
        str
            Unexpected failures, answer, and expected failures with their reasons.

        Examples
        --------
        >>> from adaptctl.recording import Verdict
        >>> Verdict().before("The error is 3 mrad.")
        'The error is 3 mrad.'
        """
        failed = [fault.sentence for fault in self.faults if fault.expected is None]
        reasons = [(fault, f" ({fault.expected})" if fault.expected else "") for fault in self.faults]
        expected = [f"As expected{why}: {fault.sentence}" for fault, why in reasons if fault.expected is not None]
        return " ".join([*(["Failed:", *failed] if failed else []), answer, *expected])

    def as_builtins(self) -> dict[str, Any]:
        """
        Return the verdict in JSON's types.

        Returns
        -------
        dict of str to Any
            Truth value `passed`, and a list `faults` of mappings.

        Examples
        --------
        >>> from adaptctl.recording import Verdict
        >>> Verdict().as_builtins()
        {'passed': True, 'faults': []}
        """
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
# Name of the hidden folder that files are written to before they are moved to their places.
STAGED = "artifacts"


# Called with what is being done, and the fraction of it (0 to 1) that is done.
Progress: TypeAlias = Callable[[str, float], object]


def silent(what: str, share: float) -> None:
    """Progress callback that does nothing."""


@contextmanager
def all_or_none(folder: str | Path, last: str = SUMMARY) -> Iterator[Path]:
    """Context manager with a folder whose files are moved into `folder` when the block ends, or not at all."""
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
    """
    Result of a finished experiment, as the command line prints and saves it.

    Nothing is checked at construction.

    Parameters
    ----------
    complete : bool
        False where the experiment was interrupted.
    headline : str
        Outcome in a sentence or two.
    facts : tuple of Fact
        Most important questions about the result, with answers.
    verdict : Verdict
        Failures of the controllers, which decide the exit code.
    write : callable
        Function of a folder and a progress callback that writes recording and report.
    failed : bool, default False
        True where the experiment itself counts its controller as failed.
    figures : callable, optional
        Function of a folder that writes the report's figures there as files. Default: none, or `write` does it.

    Examples
    --------
    >>> from adaptctl.recording import compared_runs, shown
    >>> result = shown(compared_runs(arm, {"adaptive": run}))
    >>> result.complete, len(result.facts) > 3
    (True, True)
    """

    complete: bool
    headline: str
    facts: tuple[Fact, ...]
    verdict: Verdict
    write: Callable[[Path, Progress], object]
    failed: bool = False
    figures: Callable[[Path], object] | None = None
