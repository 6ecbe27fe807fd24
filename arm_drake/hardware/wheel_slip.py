"""Where a mobile base truly is, and how its wheels slip: what odometry can't know."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    OutputPort,
)

from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.description.axles import Axle
from arm_drake.description.base_wheels import MobileBase
from arm_drake.description.rollers import Rollers
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.wheels import Wheel, find_wheels
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from arm_drake.python_system import PythonSystem

_UP = np.array([0.0, 0.0, 1.0])


class BaseTruth(PythonSystem):
    """Measures a base and its wheels against the ground z = 0, which is at rest.

    .. pydrake_system::

        name: BaseTruth
        input_ports:
        - body_poses
        - body_velocities
        - odometry
        output_ports:
        - wheel_slip
        - ground_truth

    ===============  ====  =====  =====================================================
    port             size  unit   meaning
    ===============  ====  =====  =====================================================
    body_poses       --    --     list of RigidTransform: pose of every body
    body_velocities  --    --     list of SpatialVelocity: that of every body
    odometry         --    --     Odometry as the controller publishes it; its frames
                                  are those of ground_truth. May be unconnected
    wheel_slip       2n    m/s    velocity of the lowest point of each of n wheels:
                                  forwards along them, then across them to the left.
                                  Of wheels with rollers: along the axis of the roller
                                  that is down; then 0
    ground_truth     --    --     Odometry: pose of the base from where it started, on
                                  the ground below it; its velocity in its own frame
    ===============  ====  =====  =====================================================

    It has no state.
    """

    def __init__(
        self, link: str, body: int, start: RigidTransform, wheels: Sequence[Wheel]
    ) -> None:
        """Create the system.

        Args:
            link: Name of the base's link.
            body: Index of its body.
            start: Pose of the base in the world at the start.
            wheels: The driven wheels.
        """
        super().__init__()
        self._link, self._body, self.wheels = link, body, tuple(wheels)
        yaw = RollPitchYaw(start.rotation()).yaw_angle()
        x, y, _ = start.translation()
        self._X_OW = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), [x, y, 0.0]).inverse()
        poses = AbstractValue.Make([RigidTransform()])
        velocities = AbstractValue.Make([SpatialVelocity()])
        odometry = AbstractValue.Make(Odometry())
        self._poses = self.DeclareAbstractInputPort("body_poses", poses)
        self._velocities = self.DeclareAbstractInputPort("body_velocities", velocities)
        self._odometry = self.DeclareAbstractInputPort("odometry", odometry)
        motion = {self._poses.ticket(), self._velocities.ticket()}
        self.DeclareVectorOutputPort(
            "wheel_slip", 2 * len(self.wheels), self._calc_wheel_slip, motion
        )
        self.DeclareAbstractOutputPort(
            "ground_truth",
            lambda: AbstractValue.Make(Odometry()),
            self._calc_ground_truth,
            {*motion, self._odometry.ticket(), self.time_ticket()},
        )

    def _calc_wheel_slip(self, context: Context, output: BasicVector) -> None:
        poses, velocities = self._poses.Eval(context), self._velocities.Eval(context)
        slips = [
            _slip(wheel, poses[wheel.body], velocities[wheel.body])
            for wheel in self.wheels
        ]
        output.SetFromVector(np.array(slips).reshape(-1, 2).T.ravel())

    def _calc_ground_truth(self, context: Context, output: AbstractValue) -> None:
        X_WB = self._poses.Eval(context)[self._body]
        V_WB = self._velocities.Eval(context)[self._body]
        X_OB, R_BW = self._X_OW @ X_WB, X_WB.rotation().inverse()
        q = X_OB.rotation().ToQuaternion()
        v, w = R_BW @ V_WB.translational(), R_BW @ V_WB.rotational()
        known = Odometry()
        if self._odometry.HasValue(context):
            known = self._odometry.Eval(context)
        output.set_value(
            Odometry(
                Header.from_nanoseconds(
                    round(context.get_time() * NANOSECONDS),
                    known.header.frame_id or "odom",
                ),
                known.child_frame_id or self._link,
                PoseWithCovariance(
                    Pose(
                        Point(*map(float, X_OB.translation())),
                        Quaternion(q.x(), q.y(), q.z(), q.w()),
                    )
                ),
                TwistWithCovariance(
                    Twist(Vector3(*map(float, v)), Vector3(*map(float, w)))
                ),
            )
        )


def _slip(
    wheel: Wheel, X_WB: RigidTransform, V_WB: SpatialVelocity
) -> tuple[float, float]:
    """Return the velocity of a wheel's lowest point, along and across it [m/s]."""
    R_WB = X_WB.rotation()
    axis = R_WB @ wheel.axis
    forwards = np.cross(axis, _UP)
    forwards /= np.linalg.norm(forwards)
    down = np.cross(forwards, axis)
    # From the body's origin to the lowest point.
    p = R_WB @ wheel.center - wheel.radius * down * np.sign(down[2])
    v = V_WB.translational() + np.cross(V_WB.rotational(), p)
    along, across = float(v @ forwards), float(v @ np.cross(_UP, forwards))
    if wheel.roller is None:
        return along, across
    return along * wheel.roller[0] + across * wheel.roller[1], 0.0


def add_base_truths(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    description: RobotDescription,
    controllers: Sequence[LoadedController],
    *,
    bases: Sequence[MobileBase],
    axles: Sequence[Axle],
    rollers: Sequence[Rollers],
    prefix: str,
) -> None:
    """Add what measures the bases of a robot, and export its ports.

    They are called `<controller>.wheel_slip` and `<controller>.ground_truth`.

    Args:
        builder: Where the plant and the controllers are.
        plant: The finalized plant; bases stand where they start.
        scene_graph: Its scene graph.
        model: The robot's model instance.
        description: The robot.
        controllers: Its controllers.
        bases: What they drive.
        axles: Axles that the plant has besides.
        rollers: Rollers likewise.
        prefix: Start of the names of systems and ports.
    """
    systems = {c.name: c.system for c in controllers if c.system is not None}
    for base in bases:
        if base.controller not in systems:
            continue
        context, body = plant.CreateDefaultContext(), plant.GetBodyByName
        link = body(base.link, model)
        start = plant.EvalBodyPoseInWorld(context, link)
        wheels = find_wheels(
            plant, scene_graph, model, description, base, axles, rollers
        )
        name = f"{prefix}{base.controller}:truth"
        truth = builder.AddNamedSystem(
            name, BaseTruth(base.link, int(link.index()), start, wheels)
        )
        for port, wanted in (
            (plant.get_body_poses_output_port(), "body_poses"),
            (plant.get_body_spatial_velocities_output_port(), "body_velocities"),
            (_odometry(systems[base.controller]), "odometry"),
        ):
            if port is not None:
                builder.Connect(port, truth.GetInputPort(wanted))
        for port_name in ("wheel_slip", "ground_truth"):
            exported = f"{prefix}{base.controller}.{port_name}"
            builder.ExportOutput(truth.GetOutputPort(port_name), exported)


def _odometry(system: ControllerInterface) -> OutputPort | None:
    """Return the port on which a controller publishes its odometry."""
    for index in range(system.num_output_ports()):
        port = system.get_output_port(index)
        if port.get_name().rpartition("/")[2] in ("odom", "odometry"):
            return port
    return None
