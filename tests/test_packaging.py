"""What a newcomer gets: one version, a lock that can be trusted, documents that name only what exists."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import yaml
from comparisons import comparison
from licences import locked, noted

import adaptctl
import adaptctl.envs  # registers the environments
from adaptctl.cli.basis import as_builtins
from adaptctl.cli.main import app
from adaptctl.description import builtin_names
from adaptctl.experiments import EXPERIMENTS
from adaptctl.recording.summary import sealed, summary
from adaptctl.recording.trace import quantities

ROOT = Path(__file__).resolve().parent.parent
UNPACKED = (ROOT / "PKG-INFO").is_file()
"""Whether this is a source distribution, in which folders stand where links do in a checkout."""
FOLDERS = ("adaptctl",) if UNPACKED else ("adaptctl", "envs", "experiments")
MADE = {"_build", "__pycache__"}
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("*.cff"), *(p for p in ROOT.glob("docs/**/*.*") if MADE.isdisjoint(p.parts))]
)
PAGES = [path for path in DOCUMENTS if path.suffix == ".md"]
PACKED = {".py", ".pyi", ".toml", ".xml", ".html", ".ll", ".jinja", ".typed", ".urdf", ".parquet", ".txt"}
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
SECTIONS = [
    *("Summary", "Statement of need", "State of the field", "Software design", "Research impact statement"),
    *("AI usage disclosure", "Acknowledgements", "References"),
]
"""Those that the Journal of Open Source Software requires of a paper of 750 to 1,750 words"""
MACHINE = re.compile(
    r"(?<![\w.])/(?:home|root|Users|tmp|work|opt|mnt|private)\b|[A-Z]:\\|file://|localhost|127\.0\.0\.1"
)


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def requirements() -> list[str]:
    """The lock's requirements, each in one line with its hashes."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def recipes() -> dict[str, str]:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    return dict(re.findall(r"^([a-z-]+):.*\n((?:\t.*\n)+)", makefile, re.MULTILINE))


def commands(page: Path) -> list[str]:
    """The lines of a page's console blocks."""
    blocks = FENCE.findall(page.read_text(encoding="utf-8"))
    return [line for language, block in blocks if language == "console" for line in block.splitlines()]


def test_the_version_is_one() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    version = project()["project"]["version"]
    assert adaptctl.__version__ == citation["version"] == version
    assert version in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_checks_in_other_environments_have_the_package_there() -> None:
    checked = [
        (place, recipe)
        for recipe in recipes().values()
        for place in re.findall(r"(\.venv-[a-z]+)/bin/python tests/check_", recipe)
    ]
    assert {place for place, _ in checked} == {".venv-neighbours", ".venv-data", ".venv-learn"}
    assert all(f"$(call installed-into,{place})" in recipe for place, recipe in checked)


def test_the_citation_names_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    (paper,) = citation["references"]
    assert paper["title"] == "Identifying the Independent Inertial Parameter Space of Robot Manipulators"
    assert [author["family-names"] for author in paper["authors"]] == ["Sheu", "Walker"]
    assert (paper["year"], paper["volume"], paper["issue"], paper["start"], paper["end"]) == (1991, 10, 6, 668, 683)
    assert citation["license"] == project()["project"]["license"]


def test_the_paper_cites_what_its_bibliography_has() -> None:
    paper, entries = ((ROOT / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib"))
    cited = set(re.findall(r"(?<!\w)@(\w+\d{4})", paper))
    assert cited == set(re.findall(r"^@\w+\{(\w+),$", entries, re.MULTILINE))
    assert all((ROOT / picture).is_file() for picture in re.findall(r"\]\((docs/\S+)\)", paper))
    assert 750 < len(paper.split()) <= 1000


def test_the_paper_has_the_journal_s_sections_and_invents_nothing_of_the_authors() -> None:
    paper, releasing = ((ROOT / name).read_text(encoding="utf-8") for name in ("paper.md", "docs/releasing.md"))
    assert re.findall(r"^# (.*)$", paper, re.MULTILINE) == SECTIONS
    _, head, text = paper.split("---\n", 2)
    assert yaml.safe_load(head)["affiliations"] == [{"name": "To be named at submission", "index": 1}]
    assert "# AI usage disclosure\n\nTo be stated by the authors at submission.\n" in text
    assert "affiliations and the use of AI" in releasing
    assert "://" not in paper


def test_a_placeholder_stands_for_the_address_until_there_is_one() -> None:
    clones = [line for page in PAGES for line in commands(page) if line.startswith("git clone ")]
    known = project()["project"].get("urls", {}).get("Repository")
    assert len(clones) > 3
    assert {line.split()[2] for line in clones} == {known or "REPOSITORY"}
    assert ("`REPOSITORY`" in (ROOT / "docs" / "releasing.md").read_text(encoding="utf-8")) == (known is None)


def test_the_lock_names_no_place_to_fetch_from() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    assert "://" not in text
    assert not re.search(r"^\s*-", text.replace("    --hash=", ""), re.MULTILINE)
    assert not re.search(r"^\S+ @ ", text, re.MULTILINE)


def test_every_requirement_of_the_lock_is_pinned_and_hashed() -> None:
    assert requirements()
    for line in requirements():
        assert re.match(r"[a-z0-9.-]+==\S+ ", line), line
        assert re.search(r" --hash=sha256:[0-9a-f]{64}\b", line), line


def test_the_lock_has_every_dependency() -> None:
    asked = project()["project"]["dependencies"] + project()["dependency-groups"]["dev"]
    names = {re.match(r"[\w.-]+", text)[0].lower() for text in asked}  # type: ignore[index]
    assert names <= {line.split("==")[0] for line in requirements()}


def test_folders_beside_the_package_are_part_of_it() -> None:
    for name in ("envs", "experiments"):
        link = ROOT / "adaptctl" / name
        if UNPACKED:
            assert (link / "__init__.py").is_file()
            continue
        assert link.is_symlink()
        assert link.readlink() == Path("..") / name
        assert link.resolve() == ROOT / name


def test_make_targets_that_are_named_exist() -> None:
    named = {
        (name_of(page), word)
        for page in PAGES
        for word in [
            *re.findall(r"`make ([a-z-]+)", page.read_text(encoding="utf-8")),
            *(word for line in commands(page) if line.startswith("make ") for word in line.split()[1:]),
        ]
    }
    assert len(named) > 10
    assert {(page, word) for page, word in named if word not in targets()} == set()


def test_continuous_integration_makes_targets_that_exist() -> None:
    lines = re.findall(r"^make (.*)$", (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)
    named = [word for line in lines for word in line.split() if not word.startswith("--")]
    assert {"test", "lint", "types", "docs"} == set(named) <= targets()


def test_workflows_make_targets_that_exist() -> None:
    for path in sorted((ROOT / ".github" / "workflows").glob("*.yml")):
        jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
        runs = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
        named = [word for run in runs for word in re.findall(r"\bmake ([a-z-]+)", run)]
        assert named, path
        assert set(named) <= targets(), path


def test_pages_have_commands_and_links_to_look_at() -> None:
    assert sum(line.startswith("adaptctl ") for page in PAGES for line in commands(page)) > 10
    assert sum(len(LINK.findall(page.read_text(encoding="utf-8"))) for page in PAGES) > 20


def test_links_lead_somewhere() -> None:
    links = [(page, target) for page in PAGES for target in LINK.findall(page.read_text(encoding="utf-8"))]
    files = [(page, target) for page, target in links if "://" not in target]
    assert [f"{name_of(page)}: {target}" for page, target in files if not (page.parent / target).exists()] == []


def test_documents_name_no_machine() -> None:
    texts = [path for path in DOCUMENTS if path.suffix not in (".png", ".webp")]
    found = [(name_of(path), MACHINE.search(path.read_text(encoding="utf-8"))) for path in texts]
    assert [f"{name}: {place.group()}" for name, place in found if place] == []


def test_the_readme_shows_the_two_commands() -> None:
    assert {"make demo", "make test"} <= set(commands(ROOT / "README.md"))


def test_what_can_be_chosen_by_name_is_documented() -> None:
    choices = {
        "robots.md": builtin_names(),
        "cli.md": [entry.name for entry in EXPERIMENTS] + [name for name in app if not name.startswith("-")],
        "environments.md": [name for name in gymnasium.registry if name.startswith("adaptctl/")],
    }
    for page, names in choices.items():
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        missing = [name for name in names if not re.search(rf"`[^`]*\b{name}\b", text)]
        assert not missing, f"docs/{page} does not mention {missing}"


def first_column(heading: str, end: str) -> set[str]:
    """The names in the first column of the tables of a part of the page on the command line."""
    text = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    part = text[text.index(heading) : text.index(end)]
    cells = re.findall(r"^\| (`[^|]+) \|", part, re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def test_the_keys_of_json_are_documented() -> None:
    arm = adaptctl.load("two_link")
    made = comparison(arm, samples=20)
    reduction = adaptctl.reduce(made.space, arm, components=3)
    basis = set(as_builtins(arm, made.space, made.basis, reduction))
    assert first_column("The keys of the JSON", "### Priority tables") == basis
    assert first_column("### summary.json", "### trace.parquet") == set(sealed(summary(made)))


def test_the_columns_of_a_trace_are_documented() -> None:
    arm = adaptctl.load("two_link")
    made = comparison(arm, samples=20)
    run = replace(made.subject, rollout=replace(made.subject.rollout, flags={"torque_limited": np.zeros(20)}))
    columns = {column.name.split(".")[0] for column in quantities(run, arm, made.basis.names)}
    assert {name.split(".")[0] for name in first_column("### trace.parquet", "`pandas.read")} == columns


def test_a_wheel_holds_the_package_as_real_files_and_nothing_else(tmp_path: Path) -> None:
    for name in FOLDERS:
        shutil.copytree(ROOT / name, tmp_path / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", "built", "."]
    subprocess.run(build, cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = (tmp_path / "built").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    folders = [ROOT / name for name in FOLDERS]
    files = [path for folder in folders for path in folder.rglob("*.*") if path.suffix in PACKED]
    names = {path.relative_to(ROOT).as_posix().removeprefix("adaptctl/") for path in files}
    assert held == {f"adaptctl/{name}" for name in names}


def test_licences_that_ask_for_something_are_named_in_the_documentation() -> None:
    page = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    assert len(locked()) > 50
    for name, licence in noted().items():
        assert f"| `{name}` |" in page, f"{name}: {licence}"


def test_experiments_and_environments_are_imported_from_the_package() -> None:
    """A source distribution has no folders of these names beside the package."""
    for path in [*(ROOT / "tests").glob("*.py"), *(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "docs").rglob("*.py")]:
        assert not re.search(r"^\s*(?:from|import) (?:envs|experiments)\b", path.read_text(encoding="utf-8"), re.M), (
            path
        )
