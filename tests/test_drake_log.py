"""Drake's warnings are kept for the report."""

import logging

import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.report import LoadReport
from arm_drake.drake_log import drake_messages
from arm_drake.plant import add_robot_model
from tests import models

ODD = '<robot name="r"><link name="a" type="x"/></robot>'


def parse() -> None:
    plant = MultibodyPlant(0.01)
    Parser(plant).AddModelsFromString(ODD, "urdf")


def test_warnings_are_collected_and_not_printed(capfd, caplog):
    with drake_messages() as messages:
        parse()

    (message,) = messages
    assert "The attribute 'type' found in a 'link' tag" in message
    assert capfd.readouterr() == ("", "")
    assert not caplog.records


def test_afterwards_they_go_where_they_went_before(caplog):
    with pytest.raises(ValueError, match="stop"), drake_messages():
        raise ValueError("stop")

    with caplog.at_level(logging.WARNING):
        parse()
    assert len(caplog.records) == 1


def test_a_warning_about_a_robot_is_a_line_of_its_report(tmp_path):
    robot = models.load(tmp_path, models.pendulum())
    # As if something odd had not been removed.
    urdf = robot.description.urdf.replace("<link ", '<link type="x" ', 1)
    object.__setattr__(robot.description, "urdf", urdf)
    report = LoadReport()

    add_robot_model(
        MultibodyPlant(0.01), robot.description, "robot", None, report=report
    )

    (entry,) = report
    assert entry.what.startswith("The attribute 'type' found in a 'link' tag")
    assert entry.done == "so says Drake"
