"""``{live-arm}``: the PUMA 560 that learns, as WebAssembly in the page, exported whenever the pages are made."""

import warnings
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective


def live_section() -> str:
    """HTML of the loop of the `puma560-adaptive` experiment, from its start and on its reference."""
    from adaptctl.codegen.live_arm import LiveArm
    from adaptctl.experiments.contest import live_contender
    from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
    from adaptctl.identifiability import essential_space, fundamental_basis

    experiment = Puma560Adaptive()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the page on replication tells of Table 6
        mechanism = experiment.mechanism()
    contenders = experiment.contenders(mechanism, fundamental_basis(essential_space(mechanism)))
    env = experiment.environment(mechanism)
    live = live_contender(env, contenders, experiment.seed, experiment.options)
    if not isinstance(live, LiveArm):
        raise RuntimeError(f"the home page has no live arm: {live}")
    return live.html(f"The PUMA 560 with {live.label}")


class LiveArmDirective(SphinxDirective):
    """Put the arm at the directive, in HTML."""

    def run(self) -> list[nodes.Node]:
        """The section with all that it needs."""
        if self.env.app.builder.format != "html":
            return []
        return [nodes.raw("", live_section(), format="html")]


def setup(app: Any) -> dict[str, bool]:
    """Register the directive and its style."""
    app.add_directive("live-arm", LiveArmDirective)
    app.add_css_file("live.css")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
