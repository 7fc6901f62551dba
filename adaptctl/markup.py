"""HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

MAX_TABLE_ROWS = 60
"""rows shown"""


def titled(title: str, text: str = "") -> str:
    """HTML paragraph of a bold title and a text."""
    return f"<p><b>{_escaped(title)}</b> {_escaped(text)}</p>"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """HTML table, all texts escaped."""
    given = list(rows)
    head = "".join(f"<th>{_escaped(text)}</th>" if text else "<td></td>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td>{_escaped(str(x))}</td>' for x in row)}</tr>" for row in given[:MAX_TABLE_ROWS])
    if len(given) > MAX_TABLE_ROWS:
        body += f'<tr><td colspan="{len(heads)}">and {len(given) - MAX_TABLE_ROWS} more</td></tr>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _escaped(text: str) -> str:
    from html import escape  # 2 ms, which a program outside of notebooks need not wait for

    return escape(text)
