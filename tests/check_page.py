"""WebAssembly where it is to run: in node and in a browser without a window, against Python: `make check-page`.

Twenty seconds of closed loop of two arms, law and plant as in a report, within 1e-12 N m of `simulate`; how many times
real time; the page itself opened from a file, played through its own buttons; and the class of an exported package.
Names each tool that is missing.
"""

from __future__ import annotations

import base64
import json
import os
import re
import resource
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from every_law import guarded, slotine_li

import adaptctl
from adaptctl.arrays import Array
from adaptctl.codegen.closed_loop_check import default_reference, record
from adaptctl.codegen.interface import Interface
from adaptctl.codegen.live_arm import LiveArm, live_arm
from adaptctl.recording.page import Fragment, Report, Section
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.references import REFERENCE
from benchmarks.machine import Machine
from benchmarks.tasks import PERIOD, Task, puma, semi_direct_drive

PERIODS, LONG = 20_000, 200_000
BOUND = 1e-12
"""of torques, N m, in parts of the largest where that is above 1"""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")

NODE = """
const { facts, binary } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const module_ = new WebAssembly.Module(Buffer.from(binary, "base64"));
const code = new WebAssembly.Instance(module_).exports, numbers = new Float64Array(code.memory.buffer);
const begin = () => {
  facts.start.forEach((values, j) => numbers.set(values, facts.state[j]));
  numbers.set(facts.parameter, facts.parameters);
  if (facts.gains !== null) numbers.set(facts.gain, facts.gains);
};
const period = (k) => {
  numbers[facts.time] = k * facts.period;
  code.period();
  facts.next.forEach((at, j) => numbers.copyWithin(facts.state[j], at, at + facts.sizes[j]));
};
const torque = [];
begin();
for (let k = 0; k < PERIODS; k++) {
  period(k);
  torque.push(Array.from(numbers.subarray(facts.torque, facts.torque + facts.joints.length)));
}
const started = process.cpuUsage();
begin();
for (let k = 0; k < PERIODS; k++) period(k);
const spent = process.cpuUsage(started), taken = (spent.user + spent.system) / 1e6;
process.stdout.write(JSON.stringify({ torque, taken }));
"""


def started(task: Task) -> tuple[Plant, Any, Array]:
    """A plant, and where its arm begins."""
    plant = Plant(task.arm, PERIOD)
    p = task.reference(0.0).p + 0.05
    return plant, plant.init(p, np.zeros(plant.dof)), np.asarray(task.arm.inertial_parameters)


def in_python(task: Task) -> Array:
    """Torques (T, r) of the closed loop in native code here."""
    plant, state, parameters = started(task)
    loop, points = ClosedLoop(plant, task.controller), task.references(PERIODS)
    arms = loop.compiled().ensemble(1)
    loop.set_state(arms, state, task.controller.init(state.p, state.v))
    arms.held["parameters"] = parameters
    signals = dict(zip(REFERENCE, points, strict=True)) | {"noise": np.zeros((PERIODS, 0))}
    return np.array(Sample(*(x[:, 0] for x in arms.run(PERIODS, signals, record=True))).torque)


def page_of(live: LiveArm, label: str, script: str) -> str:
    """A page with a live arm as reports have it, and what is done to it."""
    body = Report("check", label, "", sections=(Section("", (Fragment(live.html(label)),)),)).html({})
    return body.replace("</body>", f"<script>{script}</script></body>")


RUN = """
adaptctlLive.ready.then(() => {
  document.getElementById("live-play").focus();
  document.getElementById("live-play").click();
  const pressed = document.getElementById("live-play").getAttribute("aria-pressed");
  document.getElementById("live-play").click();
  document.getElementById("live-reset").click();
  const sound = adaptctlLive.run(COUNT);
  const torque = adaptctlLive.torque();
  const rms = adaptctlLive.rms();
  const slider = document.getElementById("live-payload");
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  adaptctlLive.reset();
  const loaded = adaptctlLive.run(5000) ? adaptctlLive.rms() : -1;
  const named = [...document.querySelectorAll("#live-arm input")].every((x) => x.getAttribute("aria-label"));
  const out = document.createElement("pre");
  out.id = "checked";
  out.textContent = JSON.stringify({ pressed, sound, torque, rms, loaded, named });
  document.body.append(out);
});
"""


def in_browser(browser: str, live: LiveArm, label: str, count: int) -> tuple[dict[str, Any], float]:
    """What the page said after so many control periods, and seconds of processor time that the browser took."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "page.html"
        path.write_text(page_of(live, label, RUN.replace("COUNT", str(count))), encoding="utf-8")
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={place}/profile"]
        command += ["--virtual-time-budget=1000", "--dump-dom", path.as_uri()]
        started = processor_time()
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        taken = processor_time() - started
    found = re.search(r'<pre id="checked">(.*?)</pre>', done.stdout, re.DOTALL)
    if found is None:
        raise SystemExit(f"check-page: {browser} did not run the page: {done.stderr[-500:]}")
    return json.loads(found[1]), taken


def processor_time() -> float:
    """Seconds that processes started here, and ended, have taken."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


PACKAGE = """
const { Controller } = require(process.argv[1]);
const rows = JSON.parse(require("fs").readFileSync(0, "utf8"));
const still = [0, 0, 0], rest = { p: still, v: still, a: still }, law = new Controller();
const braked = (v) => new Controller().step(still, v, rest).torque;
const early = law.setEstimate(law.estimate());
law.init(rows[0].p);
const torque = rows.map(({ p, v, reference }) => law.step(p, v, reference).torque);
const before = law.estimate();
const short = [law.step([0, 0], still, rest), law.step([...still, 0], still, rest), law.init([0, 0])];
const kept = JSON.stringify(law.estimate()) === JSON.stringify(before);
law.init(rows[0].p);
const refused = [early, law.setEstimate([1]), law.setEstimate(before.map(() => NaN))];
const warm = law.setEstimate(before) && JSON.stringify(law.estimate()) === JSON.stringify(before);
const brakes = [[1, -2, 3], [50, -50, 1e300], [NaN, Infinity, 0]].map(braked);
console.log(JSON.stringify({ torque, estimate: before, short, kept, refused, warm, brakes }));
"""


def exported_class(node: str) -> str:
    """What the class of an exported package does in node, against Python and what its README says."""
    interface = Interface(guarded(slotine_li(), torque=40.0, stop_damping=[2.0, 3.0, 4.0]))
    law, (rows, last) = interface.controller, record(interface, default_reference(interface), ticks=200)
    given = [{"p": row.p, "v": row.v, "reference": row.reference._asdict()} for row in rows]
    with tempfile.TemporaryDirectory() as place:
        made = adaptctl.export(law, Path(place) / "out", name="arm", language="wasm")
        command = [node, "-e", PACKAGE, str(made.directory / "arm.js")]
        text = json.dumps(given, default=np.ndarray.tolist)
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
    said = json.loads(done.stdout)
    np.testing.assert_allclose(said["torque"], [row.torque for row in rows], rtol=0.0, atol=1e-11 * 40.0)
    np.testing.assert_allclose(said["estimate"], last.inner.estimate, rtol=1e-9, atol=1e-12)
    assert said["brakes"] == [[-2.0, 6.0, -12.0], [-40.0, 40.0, -40.0], [0.0, 0.0, 0.0]]
    assert [answer["status"] for answer in said["short"][:2]] == [1, 1]
    assert said["short"][2] == 1
    assert said["kept"]
    assert said["refused"] == [False, False, False]
    assert said["warm"]
    return f"exported class in node: {len(rows)} steps as in Python; brake, wrong lengths, estimates as its README says"


def report() -> Iterator[str]:
    """Lines of what was checked; ends in SystemExit where something failed."""
    yield f"{Machine.here()}; load {os.getloadavg()[0]:.1f}"
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    node = shutil.which("node")
    for name, found in (("node", node), (BROWSERS[0], browser)):
        if found is None:
            yield f"missing: {name}: nothing is checked in it"
    if node:
        yield exported_class(node)
    failed = False
    for name, task in {"puma": puma(), "semi_direct_drive": semi_direct_drive()}.items():
        plant, state, parameters = started(task)
        live = live_arm(plant, task.controller, task.reference, state, parameters)
        if isinstance(live, str):
            raise SystemExit(f"check-page: {name}: {live}")
        torque = in_python(task)
        bound = BOUND * max(1.0, float(np.abs(torque).max()))
        yield f"{name}: {len(live.binary)} bytes of WebAssembly"
        if node:
            given = json.dumps({"facts": live.facts, "binary": base64.b64encode(live.binary).decode("ascii")})
            script = NODE.replace("PERIODS", str(PERIODS))
            done = subprocess.run([node, "-e", script], input=given, capture_output=True, text=True, check=True)
            said = json.loads(done.stdout)
            off = float(np.abs(np.array(said["torque"]) - torque).max())
            faster = PERIODS * PERIOD / said["taken"]
            failed |= off > bound or faster < 100.0
            yield f"  node: {off:.2g} N m off over 20 s, of {np.abs(torque).max():.3g}; {faster:.0f} times real time"
        if browser:
            said, _ = in_browser(browser, live, name, PERIODS)
            off = float(np.abs(np.array(said["torque"]) - torque[-1]).max())
            short = min(in_browser(browser, live, name, 0)[1] for _ in range(3))
            long = min(in_browser(browser, live, name, LONG)[1] for _ in range(3))
            faster = LONG * PERIOD / max(long - short, 1e-9)
            told = said["pressed"] == "true" and said["sound"] and said["named"] and said["loaded"] > 0.0
            failed |= off > bound or faster < 100.0 or not told
            yield (
                f"  {browser}: from a file; {off:.2g} N m off after 20 s; {faster:.0f} times real time; "
                f"buttons, sliders and names work: {told}; RMS error {said['rms']:.2g}, loaded {said['loaded']:.2g}"
            )
    if failed:
        raise SystemExit("check-page: FAILED")


def main() -> None:
    warnings.simplefilter("ignore")
    for line in report():
        print(line, flush=True)


if __name__ == "__main__":
    main()
