"""`adaptctl contest`: laws, robots, conditions and seeds, ranked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from adaptctl.cli.experiment import shown_progress
from adaptctl.cli.interruption import interruptible
from adaptctl.cli.output import WrappedTable, print_note, print_parts

if TYPE_CHECKING:
    from adaptctl.contest.running import ContestFolder

ONE, WHERE = "One run", "Execution"


def contest(
    file: Annotated[Path, Parameter(name="FILE")],
    /,
    *,
    out: Annotated[Path, Parameter(metavar="DIR")],
    law: Annotated[str | None, Parameter(group=ONE)] = None,
    robot: Annotated[str | None, Parameter(group=ONE)] = None,
    condition: Annotated[str | None, Parameter(group=ONE)] = None,
    seed: Annotated[int | None, Parameter(group=ONE)] = None,
    measure_step_time: Annotated[bool, Parameter(group=WHERE, negative="")] = False,
    jobs: Annotated[int | None, Parameter(group=WHERE)] = None,
    scheduler: Annotated[str | None, Parameter(group=WHERE)] = None,
    scheduler_file: Annotated[Path | None, Parameter(group=WHERE)] = None,
) -> int:
    """
    Rank adaptive laws on robots, conditions and seeds that a TOML file names.

    Writes results.parquet, ranks.parquet, index.html, figures and table.tex. What is in the folder already is not
    computed again. A law of yours is named by FILE.py:CLASS in the file's `laws`.

    Parameters
    ----------
    file : Path
        TOML file with purpose, robots, laws, conditions and seeds.
    out : Path
        Results folder. An existing contest is resumed.
    law : str
        Only this law of the file.
    robot : str
        Only this robot of the file.
    condition : str
        Only this condition of the file.
    seed : int
        Only this seed of the file.
    measure_step_time : bool
        After the runs, also time each law on this machine, which should do nothing else: to make, to compile, a step.
    jobs : int
        Number of local processes. Default: one per processor.
    scheduler : str
        Address of a Dask scheduler: tcp://, tls://.
    scheduler_file : Path
        File written by a Dask scheduler.

    Raises
    ------
    NotFoundError
        If a law, robot or condition is unknown; the message lists what there is.
    InputError
        If the file is not as above, two laws have one name, or the scheduler cannot be reached.
    FileError
        If a file cannot be read or written, or a law's file cannot be imported.
    MissingExtraError
        If the extra `sweep` is not installed.
    """
    from adaptctl.contest.contest_file import Contest
    from adaptctl.contest.running import ContestFolder
    from adaptctl.contest.step_times import write_times
    from adaptctl.sweeps.cluster import Cluster

    found = Contest.of(file).only({"law": law, "robot": robot, "condition": condition, "seed": seed})
    folder = ContestFolder(out, found)
    cluster = Cluster(jobs, scheduler, scheduler_file)
    with interruptible() as interruption, shown_progress() as progress:
        heeded = interruption.heeded(progress)
        folder.run(cluster, lambda share: heeded(f"{len(folder.entries())} laws on robots", share), print_note)
        if measure_step_time:
            write_times(folder, lambda share: heeded("times of the laws", share))
    return _told(folder)


def _told(folder: ContestFolder) -> int:
    """Print the ranks, and where to look."""
    from adaptctl.contest.report import write_report

    ranking = write_report(folder)
    rows = [row for row in ranking.table() if row["condition"] == "all"]
    heads = ("law", "knows", "rank", ranking.error_unit, "over true", "over PD with gravity", "failed")
    lines = [
        (
            row["law"], row["knows"], f"{row['rank']:.2f}", short(row["error"]), short(row["over_true"]),
            short(row["over_pd_gravity"]), f"{row['failed']} of {row['runs']}",
        )
        for row in rows
    ]  # fmt: skip
    print_parts([WrappedTable(heads, lines)])
    for row in rows:
        if row["failed"]:
            print(f"{row['law']}: {row['failure']}")
    print(f"\nCritical difference of ranks: {short(ranking.critical_difference)}")
    if (halves := ranking.halves()) is not None:
        print(f"Halves of the seeds: {halves}")
    print(f"Scoring set: {folder.contest.scoring_hash}")
    print(f"Rows:     {folder.path / 'results.parquet'}\nPage:     {folder.path / 'index.html'}")
    return 0


def short(value: float) -> str:
    """Number with three digits, or a dash."""
    return "-" if value != value else f"{value:.3g}"
