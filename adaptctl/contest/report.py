"""Files that a contest writes beside its rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adaptctl.contest.ranking import RANK_COLUMNS, Ranking
from adaptctl.contest.running import RESULTS, ContestFolder, rows_as_table, rows_of_table
from adaptctl.sweeps.folder import read_checked, write_checked

if TYPE_CHECKING:
    import pyarrow as pa

RANKS = "ranks.parquet"


def write_report(folder: ContestFolder) -> Ranking:
    """Write ranks.parquet of the rows in a contest's folder, and return the ranking."""
    rows: pa.Table = read_checked(folder.path / RESULTS)
    ranking = Ranking(rows_of_table(rows))
    write_checked(folder.path / RANKS, rows_as_table(ranking.table(), RANK_COLUMNS, folder.contest.scoring_hash))
    return ranking
