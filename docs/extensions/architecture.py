"""The picture of the folders and of what imports what: `make architecture` writes it anew, `-` shows it."""

import ast
from collections import defaultdict
from html import escape
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
BELOW = {"errors", "optional_packages", "renamed", "version", "caching", "files", "folders", "arrays"}
"""Single files that all others may use, drawn as one row."""
GROUPS = (
    ("what users run", ("cli", "contest", "sweeps", "experiments", "envs")),
    ("results", ("codegen", "hardware", "design", "identification")),
    ("runs shown, tuned, logs", ("recording", "tuning", "logs")),
    ("closed loops", ("simulation",)),
    ("laws", ("control",)),
    ("offline", ("identifiability",)),
    ("equations", ("dynamics",)),
    ("data, code", ("description", "compilation", "scalars")),
)
WIDE, HIGH, GAP, LEFT = 112, 34, 14, 120


def imports() -> dict[str, set[str]]:
    """The folders that each folder of the package imports."""
    found: dict[str, set[str]] = defaultdict(set)
    package = ROOT / "adaptctl"
    for path in sorted(package.rglob("*.py")) + [p for f in ("envs", "experiments") for p in (ROOT / f).rglob("*.py")]:
        home = path.relative_to(package if package in path.parents else ROOT).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("adaptctl"):
                found[home].add(node.module.split(".")[1] if "." in node.module else node.names[0].name)
    return {home: {name for name in names if name in found} - {home} for home, names in found.items()}


def closest(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same without arrows that others imply."""

    def reached(home: str) -> set[str]:
        return graph[home].union(*(reached(name) for name in graph[home]))

    return {home: names - set().union(*(reached(name) for name in names)) for home, names in graph.items()}


def picture() -> str:
    """The picture as SVG."""
    graph = {h: n - BELOW for h, n in imports().items() if h not in BELOW and not h.startswith("__")}
    arrows, place = closest(graph), {}
    rows = [(title, [name for name in names if name in graph]) for title, names in GROUPS]
    left_out = set(graph) - {name for _, names in rows for name in names}
    if left_out:
        raise SystemExit(f"architecture: no row has {', '.join(sorted(left_out))}: add it to GROUPS")
    for y, (_, names) in enumerate(rows):
        for x, name in enumerate(names):
            place[name] = LEFT + x * (WIDE + GAP), 10 + y * (HIGH + 46)
    width = LEFT + max(len(names) for _, names in rows) * (WIDE + GAP)
    height = 10 + len(rows) * (HIGH + 46)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="13">',
        "<title>Folders of adaptctl, and which imports which</title>",
        '<defs><marker id="end" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#888"/></marker></defs>',
    ]
    for home, names in sorted(arrows.items()):
        for name in sorted(names):
            (x, y), (to_x, to_y) = place[home], place[name]
            start, end = (y + HIGH, to_y) if to_y > y else (y + HIGH / 2, to_y + HIGH / 2)
            across = (WIDE / 2, WIDE / 2) if to_y > y else ((0, WIDE) if to_x < x else (WIDE, 0))
            lines.append(
                f'<line x1="{x + across[0]:g}" y1="{start:g}" x2="{to_x + across[1]:g}" y2="{end:g}" stroke="#888" '
                'marker-end="url(#end)"/>'
            )
    for (title, names), y in zip(rows, range(10, height, HIGH + 46), strict=False):
        lines.append(f'<text x="4" y="{y + 22}" fill="#777">{escape(title)}</text>')
        for name in names:
            x, _ = place[name]
            lines.append(
                f'<rect x="{x}" y="{y}" width="{WIDE}" height="{HIGH}" rx="5" fill="#e8eef7" stroke="#4a6fa5"/>'
            )
            lines.append(
                f'<text x="{x + WIDE / 2:g}" y="{y + 22}" text-anchor="middle" fill="#111">{escape(name)}</text>'
            )
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
