"""Services: the controller managers', parameters, odometry, time, and free things.

Sources: ros2_control's controller_manager (jazzy), rcl_interfaces, gazebo_msgs.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, Protocol

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from arm_drake.controllers import list_types
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.ros2_control import HardwareInfo
from arm_drake.errors import ArmDrakeError, InputError, check_known, suggest
from arm_drake.manager import MANAGER, SWITCH_PORT, ControllerManager
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    NANOSECONDS,
    ResetOdometry,
    SetOdometry,
    SwitchController,
)
from arm_drake.messages.control import Strictness
from arm_drake.planning.groups import find_group, find_receiver
from arm_drake.simulation.clients import is_changeable, list_parameters
from arm_drake.simulation.simulation import Simulation
from arm_drake.wire.graph import SIMULATOR, STATES, Call, Graph, Service
from arm_drake.wire.types import to_fields

_CM = "controller_manager_msgs/srv"
_RCL = "rcl_interfaces/srv"

# A switch that names no time may take so long [s] of wall time.
_LONGEST_SWITCH = 60.0

# controller_manager_msgs/srv/SwitchController: 0 is the distro's default, 2 is STRICT,
# all others are BEST_EFFORT: AUTO and FORCE_AUTO do no more in ros2_control so far.
_STRICTNESS: Mapping[int, Strictness | Literal[""]] = {0: "", 2: "strict"}

Fields = dict[str, Any]


class Controls(Protocol):
    """Controls that pause, play and reset a simulation."""

    # Whether the thread that simulates waits between two ticks.
    is_waiting: bool

    # Whether whoever runs the simulation can reset it.
    can_reset: bool

    def pause(self) -> None:
        """Let time stand."""

    def play(self) -> None:
        """Let time pass."""


class Host(Protocol):
    """Server of the services: a RosServer."""

    simulation: Simulation
    graph: Graph
    controls: Controls

    def request_reset(self) -> None:
        """Have the simulation begin anew."""

    def add_switch(
        self,
        request: SwitchController,
        reply: Callable[[Fields], None],
        timeout: float,
    ) -> None:
        """Reply when a switch is done."""


def add_services(host: Host) -> None:
    """Add all services of a simulation to its graph."""
    host.graph.services |= {each.name: each for each in _services(host)}


def _services(host: Host) -> Iterator[Service]:
    """Yield them all; of one name the last counts."""
    simulation = host.simulation
    for manager in simulation.directory.managers.values():
        yield from _ManagerServices(host, manager).services()
        yield from _controller_services(simulation, manager)
        yield from _task_space_services(simulation, manager)
    parameters = Parameters(simulation)
    for node in parameters.nodes:
        yield from _parameter_services(parameters, node)
    yield from _time_services(host)
    yield from _thing_services(simulation)


class _ManagerServices:
    """The services of a robot's controller manager."""

    def __init__(self, host: Host, manager: ControllerManager) -> None:
        self._host, self._manager = host, manager
        self._node = f"{manager.namespace}/{MANAGER}"

    def services(self) -> Iterator[Service]:
        """Yield them."""
        reading: Mapping[str, Callable[[Call], Fields | None]] = {
            "ListControllers": self._list_controllers,
            "ListControllerTypes": self._list_types,
            "ListHardwareInterfaces": self._list_interfaces,
            "ListHardwareComponents": self._list_components,
            "LoadController": self._load,
            "ConfigureController": self._configure,
            "UnloadController": self._refuse_end,
            "CleanupController": self._refuse_end,
            "ReloadControllerLibraries": self._refuse_reload,
            "SetHardwareComponentState": self._set_component,
        }
        for type_, call in reading.items():
            yield self._service(type_, call)
        yield self._service("SwitchController", self._switch, acts=True)

    def _service(
        self, type_: str, call: Callable[[Call], Fields | None], *, acts: bool = False
    ) -> Service:
        path = f"{self._node}/{_service_name(type_)}"
        return Service(path, f"{_CM}/{type_}", self._node, call, acts)

    def _active(self) -> dict[str, str]:
        """Return the states of controllers by name."""
        context = self._host.simulation.simulator.get_context()
        rows = self._manager.GetOutputPort("controllers").Eval(
            self._manager.GetMyContextFromRoot(context)
        )
        return {row.name: row.state for row in rows}

    def _claimed(self, states: Mapping[str, str]) -> set[str]:
        """Return the command interfaces that active controllers claim."""
        return {
            name
            for c in self._manager.controllers
            if c.system is not None and states[c.name] == "active"
            for name in c.system.command_interfaces
        }

    def _list_controllers(self, call: Call) -> Fields:
        states = self._active()
        claims = self._claimed(states)
        return {
            "controller": [
                self._describe(controller, states[controller.name], claims)
                for controller in self._manager.controllers
            ]
        }

    def _describe(
        self, controller: LoadedController, state: str, claims: set[str]
    ) -> Fields:
        fields: Fields = {
            "name": controller.name,
            "state": state,
            "type": controller.type,
        }
        system = controller.system
        if system is None:
            return fields
        own = f"{controller.name}/"
        commands, references = system.command_interfaces, system.reference_interfaces
        exported = system.exported_interfaces
        chained = []
        for other in self._manager.controllers:
            theirs = other.system.reference_interfaces if other.system else ()
            common = [name for name in commands if name in theirs]
            if common:
                names = _without(f"{other.name}/", common)
                chained.append({"name": other.name, "reference_interfaces": names})
        return {
            **fields,
            "update_rate": int(system.params.update_rate),
            "claimed_interfaces": list(commands) if state == "active" else [],
            "required_command_interfaces": list(commands),
            "required_state_interfaces": list(system.state_interfaces),
            "is_chainable": bool(references or exported),
            "is_chained": state == "active" and not claims.isdisjoint(references),
            "exported_state_interfaces": _without(own, exported),
            "reference_interfaces": _without(own, references),
            "chain_connections": chained,
        }

    def _list_types(self, call: Call) -> Fields:
        types, chainable = list_types(), _CHAINABLE
        if self._manager.robot.distro == "humble":
            chainable -= _NOT_IN_HUMBLE
        classes = [f"{'Chainable' * (t in chainable)}{_BASE_CLASS}" for t in types]
        return {"types": types, "base_classes": [f"{_NAMESPACE}{c}" for c in classes]}

    def _list_interfaces(self, call: Call) -> Fields:
        states = self._active()
        claims = self._claimed(states)
        parts = [
            *map(self._interfaces, self._manager.robot.description.hardware),
            *(
                _exported(controller.system, states[controller.name], claims)
                for controller in self._manager.controllers
                if controller.system is not None
            ),
        ]
        return {
            kind: [each for part in parts for each in part[kind]] for kind in _KINDS
        }

    def _list_components(self, call: Call) -> Fields:
        return {
            "component": [
                {
                    "name": block.name,
                    "type": block.type,
                    "is_async": block.is_async,
                    "rw_rate": block.rw_rate,
                    "class_type": block.plugin,
                    "plugin_name": block.plugin,
                    "state": {"id": STATES["active"], "label": "active"},
                    **self._interfaces(block),
                }
                for block in self._manager.robot.description.hardware
            ]
        }

    def _interfaces(self, block: HardwareInfo) -> Fields:
        claimed = self._claimed(self._active())
        components = (*block.joints, *block.sensors, *block.gpios)
        return {
            kind: [
                _interface(
                    name := f"{component.name}/{interface.name}",
                    interface.data_type,
                    is_claimed=name in claimed and kind == "command_interfaces",
                )
                for component in components
                for interface in getattr(component, kind)
            ]
            for kind in _KINDS
        }

    def _find(self, name: str) -> LoadedController:
        for controller in self._manager.controllers:
            if controller.name == name:
                return controller
        hint = suggest(name, [c.name for c in self._manager.controllers])
        text = "controllers are loaded when the simulation starts, of its YAML"
        raise InputError(f"no controller {name!r} ({text}); {hint}")

    def _load(self, call: Call) -> Fields:
        controller = self._find(call.request["name"])
        return {"ok": controller.system is not None}

    def _configure(self, call: Call) -> Fields:
        controller = self._find(call.request["name"])
        return {"ok": self._active()[controller.name] == "inactive"}

    def _refuse_end(self, call: Call) -> Fields:
        self._find(call.request["name"])
        text = "controllers stay loaded as long as the simulation runs"
        raise InputError(f"{text}; deactivate it by switch_controller")

    def _refuse_reload(self, call: Call) -> Fields:
        raise InputError("libraries of controllers can't be loaded anew here")

    def _set_component(self, call: Call) -> Fields:
        name = call.request["name"]
        names = [block.name for block in self._manager.robot.description.hardware]
        check_known("hardware component", name, names)
        target = call.request["target_state"]
        state = target["label"] or {v: k for k, v in STATES.items()}.get(target["id"])
        if state != "active":
            raise InputError("simulated hardware is always active")
        return {"ok": True, "state": {"id": STATES["active"], "label": "active"}}

    def _switch(self, call: Call) -> Fields | None:
        request = call.request
        activate = [
            *request["activate_controllers"],
            *request.get("start_controllers", ()),
        ]
        deactivate = [
            *request["deactivate_controllers"],
            *request.get("stop_controllers", ()),
        ]
        if not (activate or deactivate):
            return {"ok": True, "message": "no controllers are named"}
        strictness = _STRICTNESS.get(request["strictness"], "best_effort")
        switch: Any = SwitchController(tuple(activate), tuple(deactivate), strictness)
        simulation = self._host.simulation
        robot = self._manager.robot.name
        _, local = simulation.directory.address(switch, robot)
        simulation.mailbox.add_message(local, call.sender)
        port = f"{self._manager.prefix}{MANAGER}.{SWITCH_PORT}"
        simulation.publish(port, local, self._manager.period)
        timeout = _seconds(request["timeout"]) or _LONGEST_SWITCH
        self._host.add_switch(local, call.reply, min(timeout, _LONGEST_SWITCH))
        return None


_KINDS = ("command_interfaces", "state_interfaces")
_NAMESPACE, _BASE_CLASS = "controller_interface::", "ControllerInterface"

# Types that export interfaces to other controllers, and which don't in humble.
_NOT_IN_HUMBLE = frozenset(
    {
        "diff_drive_controller/DiffDriveController",
        "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
        "imu_sensor_broadcaster/IMUSensorBroadcaster",
    }
)
_CHAINABLE = _NOT_IN_HUMBLE | {
    "ackermann_steering_controller/AckermannSteeringController",
    "admittance_controller/AdmittanceController",
    "bicycle_steering_controller/BicycleSteeringController",
    "chained_filter_controller/ChainedFilter",
    "mecanum_drive_controller/MecanumDriveController",
    "omni_wheel_drive_controller/OmniWheelDriveController",
    "passthrough_controller/PassthroughController",
    "pid_controller/PidController",
    "swerve_drive_controller/SwerveController",
    "tricycle_steering_controller/TricycleSteeringController",
}


def _without(prefix: str, names: Iterable[str]) -> list[str]:
    return [name.removeprefix(prefix) for name in names]


def _interface(
    name: str,
    data_type: str = "double",
    *,
    is_available: bool = True,
    is_claimed: bool = False,
) -> Fields:
    return {
        "name": name,
        "data_type": data_type,
        "is_available": is_available,
        "is_claimed": is_claimed,
    }


def _exported(system: ControllerInterface, state: str, claims: set[str]) -> Fields:
    """Return what a controller adds to the interfaces of the hardware.

    Source: ros2_control, pull request 1098: they are available while it is active.
    """
    is_active = state == "active"
    return {
        "command_interfaces": [
            _interface(name, is_available=is_active, is_claimed=name in claims)
            for name in system.reference_interfaces
        ],
        "state_interfaces": [
            _interface(name, is_available=is_active)
            for name in system.exported_interfaces
        ],
    }


def _seconds(duration: Fields) -> float:
    return float(duration["sec"]) + 1e-9 * float(duration["nanosec"])


def _controller_services(
    simulation: Simulation, manager: ControllerManager
) -> Iterator[Service]:
    """Yield the services of single controllers."""
    for controller in manager.controllers:
        system, name = controller.system, f"{manager.prefix}{controller.name}"
        node = f"{manager.namespace}/{controller.name}"
        if system is None:
            continue
        is_pid = controller.type == "pid_controller/PidController"
        offered = {
            "query_state": hasattr(system, "query_state"),
            "set_odometry": system.HasInputPort("set_odometry"),
            "reset_odometry": system.HasInputPort("reset_odometry"),
            "set_feedforward_control": is_pid
            and manager.robot.distro in _WITH_FEEDFORWARD,
        }
        for own, (type_, call, acts) in _OF_CONTROLLERS.items():
            if offered[own]:
                bound = functools.partial(call, simulation, name)
                yield Service(f"{node}/{own}", type_, node, bound, acts)


def _task_space_services(
    simulation: Simulation, manager: ControllerManager
) -> Iterator[Service]:
    """Yield the task-space services of a robot whose arm has a controller for plans."""
    robot = manager.robot
    try:
        find_receiver(robot, find_group(robot, None))
    except InputError:
        return
    types = {
        "kinematics": "centauri_interfaces/srv/KinematicGoal",
        "home": "std_srvs/srv/SetBool",
    }
    for kind, type_ in types.items():
        name = f"/{robot.name}/{kind}"
        call = functools.partial(_ask, simulation, name)
        yield Service(name, type_, f"/{robot.name}/kinematics_server", call, acts=True)


def _ask(simulation: Simulation, name: str, call: Call) -> Fields:
    result = simulation.topic(name).call(call.request)
    fields: Fields = result._asdict()
    return fields


def _query_state(simulation: Simulation, controller: str, call: Call) -> Fields:
    time = call.request["time"]
    moment = (time["sec"] * NANOSECONDS + time["nanosec"]) / NANOSECONDS
    fields: Fields = to_fields(simulation.controller(controller).query_state(moment))
    return fields


def _set_odometry(simulation: Simulation, controller: str, call: Call) -> Fields:
    x, y, yaw = (call.request[name] for name in ("x", "y", "yaw"))
    topic = simulation.topic(f"/{controller}/set_odometry")
    topic.publish(SetOdometry(x, y, yaw), where=call.sender)
    return {"success": True, "message": ""}


def _reset_odometry(simulation: Simulation, controller: str, call: Call) -> Fields:
    topic = simulation.topic(f"/{controller}/reset_odometry")
    topic.publish(ResetOdometry(), where=call.sender)
    return {}


# Distros whose pid_controller has a service for its parameter enable_feedforward.
_WITH_FEEDFORWARD = ("humble", "jazzy")


def _set_feedforward(simulation: Simulation, controller: str, call: Call) -> Fields:
    change = {"enable_feedforward": call.request["data"]}
    simulation.controller(controller).set_parameters(change)
    return {"success": True, "message": ""}


# Services of controllers by their names: type, what does them, whether they act.
_OF_CONTROLLERS: Mapping[str, tuple[str, Callable[..., Fields], bool]] = {
    "query_state": ("control_msgs/srv/QueryTrajectoryState", _query_state, False),
    "set_odometry": ("control_msgs/srv/SetOdometry", _set_odometry, True),
    "reset_odometry": ("std_srvs/srv/Empty", _reset_odometry, True),
    "set_feedforward_control": ("std_srvs/srv/SetBool", _set_feedforward, True),
}


class Parameters:
    """The parameters of nodes: those of controllers, and of their managers."""

    def __init__(self, simulation: Simulation) -> None:
        """Create it."""
        self._simulation = simulation
        self.nodes: dict[str, str] = {}
        self._managers: dict[str, ControllerManager] = {}
        for manager in simulation.directory.managers.values():
            node = f"{manager.namespace}/{MANAGER}"
            self.nodes[node], self._managers[node] = "", manager
            for controller in manager.controllers:
                if controller.system is not None:
                    name = f"{manager.prefix}{controller.name}"
                    self.nodes[f"{manager.namespace}/{controller.name}"] = name

    def values(self, node: str) -> Fields:
        """Return the values of a node's parameters by name; None is not set."""
        controller = self.nodes[node]
        if not controller:
            rate = round(1.0 / self._managers[node].period)
            return {"update_rate": rate, "use_sim_time": True}
        manager, _, system = self._simulation.directory.find(controller)
        context = system.GetMyContextFromRoot(self._simulation.context)
        found = list_parameters(manager.robot, system, context)
        rate = int(system.params.update_rate)
        return {**found, "update_rate": rate, "use_sim_time": True}

    def is_changeable(self, node: str, name: str) -> bool:
        """Return whether a parameter may change while the simulation runs."""
        controller = self.nodes[node]
        if not controller:
            return False
        manager, _, system = self._simulation.directory.find(controller)
        return is_changeable(manager.robot, system, name)

    def set(self, node: str, changes: Mapping[str, Any]) -> None:
        """Change parameters, or raise InputError."""
        controller = self.nodes[node]
        if not controller:
            raise InputError("parameters of a manager can't change while it runs")
        values = self.values(node)
        for name in changes:
            check_known("parameter", name, values)
        self._simulation.controller(controller).set_parameters(changes)


# rcl_interfaces/msg/ParameterType: number, and the field of ParameterValue.
_NOT_SET = 0
_FIELDS = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}
_TYPES = {bool: 1, int: 2, float: 3, str: 4}


def to_parameter_value(value: Any) -> Fields:
    """Return a value as the fields of rcl_interfaces/msg/ParameterValue."""
    number = _type_number(value)
    if number == _NOT_SET:
        return {"type": 0}
    items = list(value) if number > 4 else value
    if number == 8:
        items = [float(item) for item in items]
    return {"type": number, _FIELDS[number]: items}


def _type_number(value: Any) -> int:
    if type(value) in _TYPES:
        return _TYPES[type(value)]
    if isinstance(value, list | tuple):
        kinds = {type(item) for item in value}
        if kinds == {int, float}:
            kinds = {float}
        [kind] = kinds if len(kinds) == 1 else [str]
        if kind in _TYPES and (kinds or not value):
            return _TYPES[kind] + 5
    return _NOT_SET


def from_parameter_value(fields: Fields) -> Any:
    """Return what the fields of rcl_interfaces/msg/ParameterValue hold."""
    name = _FIELDS.get(fields["type"])
    return None if name is None else fields[name]


def _parameter_services(parameters: Parameters, node: str) -> Iterator[Service]:
    """Yield the services that a node has for its parameters."""
    calls: Mapping[str, Callable[[Call], Fields]] = {
        "ListParameters": lambda call: _list(parameters.values(node), call),
        "GetParameters": lambda call: {
            "values": [
                to_parameter_value(parameters.values(node).get(name))
                for name in call.request["names"]
            ]
        },
        "GetParameterTypes": lambda call: {
            "types": [
                _type_number(parameters.values(node).get(name))
                for name in call.request["names"]
            ]
        },
        "DescribeParameters": lambda call: {
            "descriptors": [
                {
                    "name": name,
                    "type": _type_number(parameters.values(node).get(name)),
                    "read_only": not parameters.is_changeable(node, name),
                }
                for name in call.request["names"]
            ]
        },
    }
    for type_, call in calls.items():
        path = f"{node}/{_service_name(type_)}"
        yield Service(path, f"{_RCL}/{type_}", node, call)

    def set_each(call: Call) -> Fields:
        return {
            "results": [
                _set(parameters, node, [each]) for each in call.request["parameters"]
            ]
        }

    def set_all(call: Call) -> Fields:
        return {"result": _set(parameters, node, call.request["parameters"])}

    path = f"{node}/set_parameters"
    yield Service(path, f"{_RCL}/SetParameters", node, set_each, acts=True)
    path = f"{node}/set_parameters_atomically"
    yield Service(path, f"{_RCL}/SetParametersAtomically", node, set_all, acts=True)


def _list(values: Fields, call: Call) -> Fields:
    prefixes, depth = call.request["prefixes"], call.request["depth"]
    names = [
        name
        for name in values
        if (not prefixes or any(_is_below(name, p, depth) for p in prefixes))
        and (prefixes or not depth or name.count(".") < depth)
    ]
    found = sorted({name.rpartition(".")[0] for name in names} - {""})
    return {"result": {"names": names, "prefixes": found}}


def _is_below(name: str, prefix: str, depth: int) -> bool:
    below = name == prefix or name.startswith(f"{prefix}.")
    return below and (not depth or name[len(prefix) :].count(".") <= depth)


def _set(parameters: Parameters, node: str, entries: list[Fields]) -> Fields:
    changes = {each["name"]: from_parameter_value(each["value"]) for each in entries}
    try:
        parameters.set(node, changes)
    except ArmDrakeError as error:
        return {"successful": False, "reason": str(error)}
    return {"successful": True, "reason": ""}


def _time_services(host: Host) -> Iterator[Service]:
    def pause(call: Call) -> Fields:
        host.controls.pause()
        return {}

    def play(call: Call) -> Fields:
        host.controls.play()
        return {}

    def reset(call: Call) -> Fields:
        try:
            host.request_reset()
        finally:
            call.reply({})
        return {}

    for name, call in (("pause", pause), ("play", play), ("reset", reset)):
        yield Service(f"/{name}", "std_srvs/srv/Empty", SIMULATOR, call)


def _thing_services(simulation: Simulation) -> Iterator[Service]:
    """Yield services for poses of things that nothing holds."""
    plant = simulation.diagram.GetSubsystemByName("plant")
    if not isinstance(plant, MultibodyPlant):
        return
    bodies = {}
    for body in map(plant.get_body, sorted(plant.GetFloatingBaseBodies())):
        name = plant.GetModelInstanceName(body.model_instance())
        bodies[body.name() if name in bodies else name] = body
    if not bodies:
        return
    things = _Things(simulation, plant, bodies)
    path, type_ = "/set_entity_state", "gazebo_msgs/srv/SetEntityState"
    yield Service(path, type_, SIMULATOR, things.set, acts=True)
    path, type_ = "/get_entity_state", "gazebo_msgs/srv/GetEntityState"
    yield Service(path, type_, SIMULATOR, things.get)


class _Things:
    """Bodies that nothing holds, by the names of their models."""

    def __init__(
        self,
        simulation: Simulation,
        plant: MultibodyPlant,
        bodies: dict[str, RigidBody],
    ) -> None:
        self._simulation, self._plant, self._bodies = simulation, plant, bodies

    def _find(self, name: str, frame: str) -> RigidBody:
        if name not in self._bodies:
            raise InputError(f"nothing free {name!r}; {suggest(name, self._bodies)}")
        if frame not in ("", "world"):
            raise InputError(f"reference_frame: expected 'world', got {frame!r}")
        return self._bodies[name]

    def set(self, call: Call) -> Fields:
        """Put a thing somewhere."""
        state = call.request["state"]
        body = self._find(state["name"], state["reference_frame"])
        pose = _to_pose(state["pose"])
        twist = np.array(
            [
                state["twist"][part][axis]
                for part in ("angular", "linear")
                for axis in "xyz"
            ]
        )
        if not np.all(np.isfinite(twist)):
            raise InputError("twist: expected finite numbers")
        context = self._plant.GetMyMutableContextFromRoot(self._simulation.context)
        self._plant.SetFloatingBaseBodyPoseInWorldFrame(context, body, pose)
        velocity = SpatialVelocity(twist)
        self._plant.SetFreeBodySpatialVelocity(context, body, velocity)
        return {"success": True}

    def get(self, call: Call) -> Fields:
        """Return where a thing is."""
        body = self._find(call.request["name"], call.request["reference_frame"])
        context = self._plant.GetMyContextFromRoot(self._simulation.context)
        pose = self._plant.EvalBodyPoseInWorld(context, body)
        velocity = self._plant.EvalBodySpatialVelocityInWorld(context, body)
        w, x, y, z = pose.rotation().ToQuaternion().wxyz().tolist()
        return {
            "success": True,
            "state": {
                "name": call.request["name"],
                "reference_frame": "world",
                "pose": {
                    "position": _vector(pose.translation()),
                    "orientation": {"x": x, "y": y, "z": z, "w": w},
                },
                "twist": {
                    "linear": _vector(velocity.translational()),
                    "angular": _vector(velocity.rotational()),
                },
            },
        }


def _service_name(type_: str) -> str:
    """Return the usual name of a service of a type, such as list_controllers."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in type_)[1:]


def _vector(values: Any) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _to_pose(fields: Fields) -> RigidTransform:
    position = np.array([fields["position"][axis] for axis in "xyz"])
    turn = np.array([fields["orientation"][axis] for axis in "wxyz"])
    if not (np.all(np.isfinite(position)) and np.all(np.isfinite(turn))):
        raise InputError("pose: expected finite numbers")
    norm = float(np.linalg.norm(turn))
    if norm == 0.0:  # A quaternion left out.
        turn, norm = np.array([1.0, 0.0, 0.0, 0.0]), 1.0
    return RigidTransform(RotationMatrix(Quaternion(turn / norm)), position)
