"""What topics tell, beside the ports that they are read from."""

import pytest

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    JointTrajectory,
    JointTrajectoryPoint,
)
from arm_drake.simulation.topics import TopicNames
from arm_drake.wire.server import RosServer
from arm_drake.wire.types import to_fields
from tests.wire.served import simulation


@pytest.mark.parametrize("robot", ["doosan_a0912", "teslabot"])
def test_what_is_read_of_a_tick_makes_the_message_of_the_port(robot: str) -> None:
    sim = simulation(robot)
    server = RosServer(sim, ())
    ports = {
        topic.name: (topic.outputs[0], server.graph.topics[topic.name])
        for topic in TopicNames(sim.directory.managers).all()
        if topic.outputs and topic.name in server.graph.topics
    }
    looks = [
        (source, topic)
        for source, topic in ports.values()
        if isinstance(source.system, ControllerInterface)
        and source.system.find_look(source.port)
    ]
    assert {"/joint_states", "/dynamic_joint_states"} <= {t.name for _, t in looks}
    compared = 0
    for tick in range(30):
        if tick == 10:
            for name in next(iter(sim.directory.managers.values())).controllers:
                if name.type.endswith("/JointTrajectoryController"):
                    sim.controller(name.name).send_goal(goal(name))
        sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
        context = sim.simulator.get_context()
        server.graph.update([topic for _, topic in looks], sim.time)
        later = [(s, t, t.waiting.popleft()) for s, t in looks]
        # What was read isn't touched by ticks that come before it is made.
        expected = [
            sim.diagram.GetOutputPort(s.exported_as(s.port)).Eval(context)
            for s, _ in looks
        ]
        wanted = [to_fields(message) for message in expected]
        sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
        for (_, topic, value), fields in zip(later, wanted, strict=True):
            made = topic.convert(value, 0)
            if made is not None:
                complete = server.types.complete
                kind, both = topic.type, (made, fields)
                found, port = (repr(complete(kind, each)) for each in both)
                assert found == port, topic.name
                compared += 1
    assert compared >= 2 * 29


def goal(controller: LoadedController) -> FollowJointTrajectoryGoal:
    system = controller.system
    assert system is not None
    names = tuple(name.rpartition("/")[0] for name in system.command_interfaces)
    point = JointTrajectoryPoint(
        (0.1,) * len(names), time_from_start=Duration(0, 2 * 10**8)
    )
    return FollowJointTrajectoryGoal(
        JointTrajectory(joint_names=names, points=(point,))
    )
