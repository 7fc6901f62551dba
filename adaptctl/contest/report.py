"""Files that a contest writes beside its rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptctl.contest.figures import write_paper
from adaptctl.contest.page import write_page
from adaptctl.contest.ranking import RANK_COLUMNS, Ranking
from adaptctl.contest.running import RESULTS, ContestFolder, rows_as_table, rows_of_table
from adaptctl.contest.step_times import kept_times, slowest
from adaptctl.sweeps.folder import read_checked, write_checked

if TYPE_CHECKING:
    import pyarrow as pa

RANKS, PAGE = "ranks.parquet", "index.html"


def write_report(folder: ContestFolder) -> Ranking:
    """Write all files of the rows in a contest's folder but these, and return the ranking."""
    rows: pa.Table = read_checked(folder.path / RESULTS)
    ranking = Ranking(rows_of_table(rows), folder.contest.families, folder.contest.error_unit)
    table = ranking.table()
    write_checked(folder.path / RANKS, rows_as_table(table, RANK_COLUMNS, folder.contest.scoring_hash))
    write_page(folder.path / PAGE, folder.contest, ranking, table, slowest(kept_times(folder)))
    write_paper(folder.path, ranking, table, folder.contest.asked.duration)
    return ranking
