"""All commands and examples of README and docs from empty folders, with an installed wheel: `make check-examples`.

Builds the wheel and installs it without its dependencies beside those of the environment, so that nothing of the clone
is importable. `python tests/check_examples.py quickstart` takes pages whose names contain a word.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def installed(folder: Path) -> Path:
    """Interpreter of an environment with the wheel, which sees the packages of this one."""
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    python = folder / "venv" / "bin" / "python"
    [wheel] = folder.glob("*.whl")
    subprocess.run([str(python), "-m", "pip", "install", "--quiet", "--no-deps", str(wheel)], check=True)
    here = next(path for path in sys.path if path.endswith("site-packages"))
    site = next((folder / "venv" / "lib").glob("python*/site-packages"))
    beside = [here, *map(str, Path(here).glob("cmeel.prefix/lib/python*/site-packages"))]  # the second has pinocchio
    (site / "beside.pth").write_text(f"import sys; sys.path.extend({beside!r})\n")
    (folder / "venv" / "bin" / "rerun").symlink_to(Path(sys.executable).parent / "rerun")
    return python


def main(words: list[str]) -> int:
    pages = [ROOT / "README.md", *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts)]
    chosen = [page for page in pages if not words or any(word in page.name for word in words)]
    for name in ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE"):  # the second: each command would compile all its modules
        os.environ.pop(name, None)
    failed = []
    with tempfile.TemporaryDirectory() as place:
        python = installed(Path(place))
        for page in chosen:
            (folder := Path(place) / "empty" / page.stem).mkdir(parents=True)
            command = [str(python), str(ROOT / "tests" / "followed_page.py"), str(page)]
            done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=False)
            print(f"{page.relative_to(ROOT)}: {'failed' if done.returncode else 'passed'}", flush=True)
            failed += [f"\n{page.name}:\n{done.stdout}"] if done.returncode else []
    print("\n".join(failed))
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
