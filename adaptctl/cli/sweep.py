"""`adaptctl sweep`: many runs of an experiment, kept as a table."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from adaptctl.cli.experiment import shown_progress
from adaptctl.cli.interruption import interruptible
from adaptctl.cli.output import Json, print_json
from adaptctl.errors import InputError, VerdictError

if TYPE_CHECKING:
    from adaptctl.sweeps.study import SweepStudy

STATUS_SCHEMA = "adaptctl/sweep/2"
MAX_UNASKED_RUNS = 20_000
"""Runs that are not started without being asked for."""
WHERE, WHAT = "Execution", "Runs"
Swept = Annotated[Path, Parameter(name="FOLDER", help="Results folder of a sweep.")]

app = App(name="sweep")


@app.default
def sweep(
    target: Annotated[str, Parameter(name="EXPERIMENT|STUDY")],
    /,
    *,
    out: Annotated[Path, Parameter(metavar="DIR", group=WHAT)],
    controllers: Annotated[str, Parameter(group=WHAT)] = "",
    sampling: Annotated[Literal["grid", "latin-hypercube", "sobol"] | None, Parameter(group=WHAT)] = None,
    samples: Annotated[int, Parameter(group=WHAT)] = 0,
    precision: Annotated[Literal["double", "single"] | None, Parameter(group=WHAT)] = None,
    search: Annotated[int, Parameter(group=WHAT)] = 0,
    objective: Annotated[str, Parameter(group=WHAT)] = "final_rms_error",
    yes: Annotated[bool, Parameter(group=WHAT)] = False,
    fail_on_failure: Annotated[bool, Parameter(negative=(), group=WHAT)] = False,
    jobs: Annotated[int | None, Parameter(group=WHERE)] = None,
    scheduler: Annotated[str | None, Parameter(group=WHERE)] = None,
    scheduler_file: Annotated[Path | None, Parameter(group=WHERE)] = None,
    tls_ca: Annotated[Path | None, Parameter(group=WHERE)] = None,
    tls_cert: Annotated[Path | None, Parameter(group=WHERE)] = None,
    tls_key: Annotated[Path | None, Parameter(group=WHERE)] = None,
    shard_size: Annotated[int, Parameter(group=WHERE)] = 256,
    **settings: Annotated[str, Parameter(help="Values of a setting: 4,8,12, 0..99, 0..5:11, or 0..5 to sample.")],
) -> int:
    """
    Run an experiment for every combination of settings.

    Writes the results, a row for each controller, to sweep.parquet, with report.html; runs that are in the folder
    already are not computed again. A search writes best.toml.

    Parameters
    ----------
    target : str
        An experiment, a shipped study, or a .toml file.
    out : Path
        Results folder. An existing sweep is resumed.
    controllers : str
        Controllers to run, separated by commas. Default: all.
    sampling : str
        Method of combining the settings.
    samples : int
        Number of runs, for a --sampling other than grid.
    precision : str
        Precision of batched runs: double by default; single is faster.
    search : int
        Search for the best settings, with this number of runs (extra `search`).
    objective : str
        Column of the table that the search minimises.
    yes : bool
        Start without confirmation.
    fail_on_failure : bool
        Exit with 3 if a run of the controllers diverged or failed.
    jobs : int
        Number of local processes. Default: one per processor.
    scheduler : str
        Address of a Dask scheduler: tcp://, tls://.
    scheduler_file : Path
        File written by a Dask scheduler.
    tls_ca : Path
        Certificate authority of the scheduler.
    tls_cert : Path
        Certificate of this client.
    tls_key : Path
        Key of this client.
    shard_size : int
        Number of runs in a shard, a file of runs that are computed and stored together.

    Raises
    ------
    NotFoundError
        If an experiment, study or setting is unknown.
    InputError
        If an argument is not as above, more than 20000 runs are asked for without `yes`, the folder holds other files,
        or the scheduler cannot be reached.
    FileError
        If a file cannot be read or written.
    MissingExtraError
        If the extra `sweep` or `search` is not installed.
    VerdictError
        With `fail_on_failure`, if a run diverged or failed.
    """
    from adaptctl.sweeps.cluster import Cluster
    from adaptctl.sweeps.cluster import sweep as swept
    from adaptctl.sweeps.folder import Folder
    from adaptctl.sweeps.report import write_report
    from adaptctl.sweeps.rows import validate_controllers
    from adaptctl.sweeps.study import SweepStudy

    if not 1 <= shard_size <= 100_000:
        raise InputError(f"--shard-size: expected 1 to 100000 runs, got {shard_size}")
    names = tuple(name.strip() for name in controllers.split(",") if name.strip())
    options: dict[str, Any] = {
        "controllers": names,
        "sampling": "sobol" if search else sampling,
        "samples": search or samples,
        "precision": precision,
    }
    study = SweepStudy.named(target, settings, **options)
    if samples and study.sampling == "grid":
        raise InputError("--samples is not for a grid: give --sampling latin-hypercube or sobol")
    if search and fail_on_failure:
        raise InputError("--fail-on-failure is for the rows of a sweep, and a --search keeps none")
    if search:
        return _search(study, objective, search, out)
    _validate_few(study.count, yes)
    tls = [path for path in (tls_ca, tls_cert, tls_key) if path]
    if len(tls) not in (0, 3):
        raise InputError("TLS needs --tls-ca, --tls-cert and --tls-key")
    cluster = Cluster(jobs, scheduler, scheduler_file, (tls[0], tls[1], tls[2]) if tls else None)
    validate_controllers(study.experiment, study.runs(), study.controllers)
    folder = Folder.opened(out, study, shard_size, sys.argv[1:])
    with interruptible() as interruption, shown_progress() as progress:
        heeded = interruption.heeded(progress)
        swept(folder, cluster, lambda share: heeded(f"{study.count} runs", share))
    write_report(out)
    _print_status(out)
    if fail_on_failure:
        _validate_none_failed(out)
    return 0


def _validate_none_failed(folder: Path) -> None:
    """Raise `VerdictError` if a row diverged or failed."""
    from adaptctl.sweeps.report import SweepReport

    report = SweepReport.of(folder)
    counts = report.counts(report.rows)
    if counts["diverged"] or counts["failed"]:
        raise VerdictError(f"of {len(report.rows)} rows, {counts['diverged']} diverged and {counts['failed']} failed")


@app.command
def status(folder: Swept, /, *, json: Json = False) -> int:
    """
    Print the progress of a sweep, and its results so far.

    A sweep keeps its rows in files of so many runs each, its shards. With `json`
    an object with the numbers `shards`, `shards_in_all` and `runs` is printed.
    """
    from adaptctl.sweeps.folder import saved_study

    study = saved_study(folder)
    shards = len(list((folder / "shards").glob("[!.]*.parquet")))
    if json:
        counts = {"shards": shards, "shards_in_all": -(-study.runs // study.shard), "runs": study.runs}
        print_json({"schema": STATUS_SCHEMA, **counts})
        return 0
    print(f"{shards} of {-(-study.runs // study.shard)} shards of {study.shard} runs are complete")
    return _print_status(folder) if shards else 0


@app.command
def report(folder: Swept, /) -> int:
    """Write report.html of what a sweep has so far: maps, the worst runs, and the commands that show them."""
    from adaptctl.sweeps.report import write_report

    print(f"Report:   {write_report(folder)}")
    return 0


def _print_status(folder: Path) -> int:
    from adaptctl.sweeps.report import SweepReport

    print(SweepReport.of(folder).text())
    if (folder / "sweep.parquet").is_file():
        print(f"\nRows:     {folder / 'sweep.parquet'}\nReport:   {folder / 'report.html'}")
    return 0


def _search(study: SweepStudy, minimise: str, trials: int, out: Path) -> int:
    from adaptctl.folders import made_folder
    from adaptctl.sweeps.search import search, write_settings

    if any(made_folder(out).iterdir()):
        raise InputError(f"{out}: the folder is not empty: choose another --out")
    with interruptible() as interruption, shown_progress() as progress:
        heeded = interruption.heeded(progress)
        found = search(study, minimise, trials, lambda share: heeded(f"{trials} runs", share))
    write_settings(out / "best.toml", study, found)
    print(f"{minimise} {found.value:.4g} of {found.controller}, the best of {trials} runs, with these settings:")
    for name, value in found.settings.items():
        print(f"  {name}  {value}")
    print(f"\nRun it again:  adaptctl sweep {out / 'best.toml'} --out {out / 'again'}")
    return 0


def _validate_few(count: int, yes: bool) -> None:
    """Ask before a large grid that may have been meant smaller; refuse it where no terminal can answer."""
    if count <= MAX_UNASKED_RUNS or yes:
        return
    if sys.stdin.isatty():
        print(f"{count} runs. Start? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise InputError(f"{count} runs need a confirmation: add --yes, or give fewer values")
