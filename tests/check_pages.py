"""Pages for every reader: the documentation and reports in a browser without a window: `make check-pages`.

Every page at the widths of a phone, a tablet and a screen, light and dark: findings of axe-core, whether the page
scrolls sideways, and whether figures are wide enough for their text; and the rules of html-validate. Names each tool
that is missing, and does the rest.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

WIDTHS, SCHEMES = (390, 768, 1280), ("light", "dark")
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
LEGIBLE = 700
"""px of width from which the text of the documentation's figures has 9 px"""
PACKAGES = Path("build/pages")
"""where `npm install --prefix` has put what node needs"""
SERIOUS = ("serious", "critical")
RULES = {
    "root": True,
    "extends": ["html-validate:standard"],
    "rules": {
        # matters of taste, of the writers of HTML that are used here, and what axe-core looks at in a browser
        **dict.fromkeys(
            ("no-trailing-whitespace", "long-title", "no-inline-style", "void-style", "attr-quotes"), "off"
        ),
        **dict.fromkeys(("prefer-native-element", "no-implicit-button-type", "valid-id", "wcag/h32"), "off"),
        **dict.fromkeys(("tel-non-breaking", "svg-focusable", "no-raw-characters", "no-redundant-role"), "off"),
    },
}

SCRIPT = """
const { pages, browser, widths, schemes, least } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const axe = require("fs").readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const look = async (least) => {
  const { violations } = await axe.run(document, { resultTypes: ["violations"] });
  const told = ({ id, impact, nodes }) => ({ id, impact, count: nodes.length, first: nodes[0].html.slice(0, 120) });
  const figures = [...document.querySelectorAll("article img")].filter(({ src }) => /[.](png|svg)$/.test(src));
  const small = figures.filter(({ width, naturalWidth }) => width < Math.min(least, naturalWidth));
  const narrow = small.map(({ src }) => src.split("/").pop());
  return { wide: document.documentElement.scrollWidth, narrow, found: violations.map(told) };
};
(async () => {
  const args = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"];
  const running = await require("puppeteer-core").launch({ executablePath: browser, args, protocolTimeout: 600000 });
  for (const page of pages) for (const width of widths) {
    const tab = await running.newPage();  // one that has looked at hundreds of pages may be gone
    await tab.setViewport({ width, height: 900 });
    await tab.goto("file://" + page, { timeout: 600000 });
    await tab.evaluate(axe);
    for (const scheme of schemes) {
      await tab.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
      console.log(JSON.stringify({ page, width, scheme, ...(await tab.evaluate(look, least)) }));
    }
    await tab.close();
  }
  await running.close();
})();
"""


def missing() -> list[str]:
    """Sentences on tools that are not here."""
    told = [] if shutil.which("node") else ["node is missing: nothing can be looked at"]
    if not any(map(shutil.which, BROWSERS)):
        told.append(f"a browser is missing (one of {', '.join(BROWSERS)}): axe-core is left out")
    for package in ("puppeteer-core", "axe-core", "html-validate"):
        if not (PACKAGES / "node_modules" / package).is_dir():
            told.append(f"{package} is missing: npm install --prefix {PACKAGES} {package}")
    return told


def look(pages: Sequence[Path]) -> Iterator[dict[str, Any]]:
    """What axe-core finds on every page, at every width, light and dark."""
    browser = next(path for path in map(shutil.which, BROWSERS) if path)
    given = json.dumps(
        {
            "pages": [str(p.resolve()) for p in pages],
            "browser": browser,
            "widths": WIDTHS,
            "schemes": SCHEMES,
            "least": LEGIBLE,
        }
    )
    script = PACKAGES / "look.js"
    script.write_text(SCRIPT, encoding="utf-8")
    with subprocess.Popen(["node", script], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        with running.stdin:
            running.stdin.write(given)
        yield from map(json.loads, running.stdout)
    if running.returncode:
        raise SystemExit(f"the browser ended with {running.returncode}")


def invalid(pages: Sequence[Path]) -> dict[tuple[str, str], int]:
    """How often each rule of HTML is broken, and how."""
    (PACKAGES / ".htmlvalidate.json").write_text(json.dumps(RULES), encoding="utf-8")
    program = PACKAGES / "node_modules" / ".bin" / "html-validate"
    command = [program, "--config", PACKAGES / ".htmlvalidate.json", "--formatter", "json", *pages]
    done = subprocess.run(command, check=False, text=True, stdout=subprocess.PIPE)
    found: dict[tuple[str, str], int] = {}
    for file in json.loads(done.stdout):
        for message in file["messages"]:
            kind = message["ruleId"], message["message"]
            found[kind] = found.get(kind, 0) + 1
    return found


def main(pages: Sequence[Path]) -> int:
    """1 where there is something serious, a page scrolls sideways, or HTML is not valid."""
    lacking, bad = missing(), 0
    for sentence in lacking:
        print(sentence)
    without = " ".join(lacking)
    if not any(tool in without for tool in ("node is", "browser", "puppeteer-core", "axe-core is")):
        for one in look(pages):
            wide = [f"scrolls sideways ({one['wide']} px)"] if one["wide"] > one["width"] else []
            wide += [f"{figure} is too small for its text" for figure in one["narrow"]]
            told = wide + [f"{f['id']} ({f['impact']}) {f['count']} times: {f['first']}" for f in one["found"]]
            bad += len(wide) + sum(f["impact"] in SERIOUS for f in one["found"])
            for sentence in told:
                print(f"{one['page']}, {one['width']} px, {one['scheme']}: {sentence}", flush=True)
    if not any(tool in without for tool in ("node is", "html-validate is")):
        broken = invalid(pages)
        bad += sum(broken.values())
        for (rule, message), count in broken.items():
            print(f"{rule}, {count} times: {message}")
    print(f"{len(pages)} pages: {bad} findings that matter")
    return bool(bad)


if __name__ == "__main__":
    given = [Path(word) for word in sys.argv[1:]]
    sys.exit(main(sorted(p for one in given for p in (one.rglob("*.html") if one.is_dir() else [one]))))
