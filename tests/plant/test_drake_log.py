"""Drake's warnings are kept for the report.

Each test has a process of its own: the commands switch to Drake's own logging.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests import models

# It prints what was collected, and what was logged before and after.
COLLECT = """
import json, logging
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from arm_drake.plant.plant import drake_messages

logged = []
class Handler(logging.Handler):
    def emit(self, record):
        logged.append(record.getMessage())
logging.getLogger().addHandler(Handler())

def parse():
    plant = MultibodyPlant(0.01)
    Parser(plant).AddModelsFromString(
        '<robot name="r"><link name="a" type="x"/></robot>', "urdf"
    )

try:
    with drake_messages() as messages:
        parse()
        during = len(logged)
        raise ValueError
except ValueError:
    parse()
print(json.dumps([messages, during, logged]))
"""

REPORT = """
import json, sys
from pydrake.multibody.plant import MultibodyPlant
import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.plant import plant as mut
from arm_drake.plant.plant import add_robot_model

robot = ad.load_robot(sys.argv[1])
# As if something odd were written.
write = mut.write_urdf
mut.write_urdf = lambda *robot: write(*robot).replace("<link", '<link type="x"', 1)
report = LoadReport()
plant = MultibodyPlant(0.01)
add_robot_model(plant, robot.description, "robot", None, report=report)
print(json.dumps(report.to_json()))
"""


def run(script: str, *arguments: str) -> Any:
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert done.stderr == ""
    return json.loads(done.stdout)


@pytest.mark.slow
def test_warnings_are_collected_and_not_logged_until_the_end() -> None:
    messages, during, logged = run(COLLECT)

    (message,) = messages
    assert "The attribute 'type' found in a 'link' tag" in message
    assert during == 0
    assert len(logged) == 1


@pytest.mark.slow
def test_a_warning_about_a_robot_is_a_line_of_its_report(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(models.pendulum(), encoding="utf-8")

    (entry,) = run(REPORT, str(file))

    assert entry["what"].startswith("The attribute 'type' found in a 'link' tag")
    assert (entry["severity"], entry["done"]) == ("warning", "so says Drake")
