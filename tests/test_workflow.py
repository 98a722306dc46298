"""The workflow runs what `.ci/run` runs."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_step_is_in_the_workflow_once():
    (steps,) = re.findall(r"^all_steps=\((.*)\)$", (ROOT / ".ci" / "run").read_text(), re.MULTILINE)
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    (groups,) = re.findall(r"^        steps:\n((?:          - .*\n)+)", workflow, re.MULTILINE)
    assert sorted(groups.replace("- ", " ").split()) == sorted(steps.split())
