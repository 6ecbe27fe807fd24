"""The smallest robots that show an effect, as URDF text, and what loads them."""

import dataclasses as dc
from pathlib import Path
from typing import Any

import arm_drake as ad

# Mass [kg] at a distance [m] from the axis, and its moment of inertia about that axis.
MASS = 1.0
LENGTH = 0.5
INERTIA = 1e-3 + MASS * LENGTH**2

GRAVITY = 9.81


def ros2_control(
    *joints: str, command: str = "position", states: tuple[str, ...] = ()
) -> str:
    """Return a block that commands joints, and reports further ones."""
    blocks = []
    for name in (*joints, *states):
        commands = f'<command_interface name="{command}"/>' if name in joints else ""
        blocks.append(f"""
    <joint name="{name}">
      {commands}
      <state_interface name="position"/>
      <state_interface name="velocity"/>
      <state_interface name="effort"/>
    </joint>""")
    return f"""
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>
    {"".join(blocks)}
  </ros2_control>"""


def bob(name: str, xyz: str = f"0 0 {-LENGTH}", geometry: str = "") -> str:
    """Return a link of 1 kg, with its centre of mass at a place."""
    return f"""
  <link name="{name}">
    <inertial>
      <origin xyz="{xyz}"/><mass value="{MASS}"/>
      <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial>
    {geometry}
  </link>"""


def sphere(radius: float) -> str:
    """Return a ball to collide with, at the origin of its link."""
    return f'<collision><geometry><sphere radius="{radius}"/></geometry></collision>'


def joint(
    name: str,
    parent: str,
    child: str,
    *,
    xyz: str = "0 0 0",
    axis: str = "0 1 0",
    type: str = "revolute",
    limit: str = 'lower="-3" upper="3" effort="100" velocity="10"',
    inside: str = "",
) -> str:
    """Return a joint; by default it turns about y, the bob of its child hangs."""
    return f"""
  <joint name="{name}" type="{type}">
    <origin xyz="{xyz}"/><axis xyz="{axis}"/>
    <parent link="{parent}"/><child link="{child}"/>
    <limit {limit}/>
    {inside}
  </joint>"""


def pendulum(
    *,
    limit: str = 'lower="-3" upper="3" effort="100" velocity="10"',
    dynamics: str = "",
    control: str | None = None,
) -> str:
    """Return a bob on a joint "swing", which is commanded unless ``control`` says."""
    control = ros2_control("swing") if control is None else control
    swing = joint("swing", "base", "bob", limit=limit, inside=dynamics)
    links = f'<link name="base"/>{bob("bob")}'
    return f'<robot name="pendulum">{links}{swing}{control}</robot>'


# Upper and lower arm in a vertical plane, each a bob: strongly coupled, and damped.
TWO_LINKS = f"""
<robot name="two_links">
  <link name="base"/>{bob("upper")}{bob("lower")}
  {joint("shoulder", "base", "upper", inside='<dynamics damping="0.5"/>')}
  {
    joint(
        "elbow",
        "upper",
        "lower",
        xyz=f"0 0 {-LENGTH}",
        inside='<dynamics damping="0.2"/>',
    )
}
  {ros2_control("shoulder", "elbow")}
</robot>"""

# As TWO_LINKS, but written from the tip to the base: file and tree differ in order.
TIP_FIRST = f"""
<robot name="tip_first">
  {bob("lower")}{bob("upper")}<link name="base"/>
  {joint("elbow", "upper", "lower", xyz=f"0 0 {-LENGTH}")}
  {joint("shoulder", "base", "upper")}
  {ros2_control("elbow", "shoulder")}
</robot>"""

# Three joints in a row, of which the middle one has no command interface.
PARTLY_COMMANDED = f"""
<robot name="partly">
  <link name="base"/>{bob("one")}{bob("two")}{bob("three")}
  {joint("first", "base", "one")}
  {joint("second", "one", "two", axis="0 0 1", xyz=f"0 0 {-LENGTH}")}
  {joint("third", "two", "three", xyz=f"0 0 {-LENGTH}")}
  {ros2_control("third", "first", states=("second",))}
</robot>"""

# A mass on a vertical slide.
LIFT = f"""
<robot name="lift">
  <link name="base"/>{bob("load", "0 0 0")}
  {
    joint(
        "slide",
        "base",
        "load",
        axis="0 0 1",
        type="prismatic",
        limit='lower="-1" upper="1" effort="100" velocity="2"',
    )
}
  {ros2_control("slide")}
</robot>"""

# A finger, and one that follows it at -0.5 times its angle plus 0.1 rad.
GRIPPER = f"""
<robot name="gripper">
  <link name="base"/>{bob("left")}{bob("right")}
  {joint("finger", "base", "left")}
  {
    joint(
        "follower",
        "base",
        "right",
        xyz="0 1 0",
        inside='<mimic joint="finger" multiplier="-0.5" offset="0.1"/>',
    )
}
  {ros2_control("finger", states=("follower",))}
</robot>"""

# A ball of 0.1 m that falls along z from 1 m above the ground.
FALLING_BALL = f"""
<robot name="falling_ball">
  <link name="base"/>{bob("ball", "0 0 0", sphere(0.1))}
  {
    joint(
        "fall",
        "base",
        "ball",
        xyz="0 0 1",
        axis="0 0 1",
        type="prismatic",
        limit='lower="-5" upper="5" effort="0" velocity="0"',
    )
}
  {ros2_control(states=("fall",))}
</robot>"""

# Three links whose first and last overlap by 0.1 m.
OVERLAPPING = f"""
<robot name="overlapping">
  <link name="base"/>{bob("first", "0 0 0", sphere(0.1))}
  {bob("middle", "0 0 0")}{bob("last", "0 0 0", sphere(0.1))}
  {joint("one", "base", "first", xyz="0 0 1")}
  {joint("two", "first", "middle", xyz="0.05 0 0")}
  {joint("three", "middle", "last", xyz="0.05 0 0")}
</robot>"""


def trajectory_controllers(
    joints_of: dict[str, list[str]], *, update_rate: int = 100, **parameters: Any
) -> str:
    """Return a YAML with a JointTrajectoryController per name, for these joints."""
    types = "".join(
        f"\n    {name}:"
        "\n      type: joint_trajectory_controller/JointTrajectoryController"
        for name in joints_of
    )
    settings = "".join(f"\n    {key}: {value}" for key, value in parameters.items())
    sections = "".join(
        f"""
{name}:
  ros__parameters:
    joints: [{", ".join(names)}]
    command_interfaces: [position]
    state_interfaces: [position, velocity]{settings}
"""
        for name, names in joints_of.items()
    )
    return f"""
controller_manager:
  ros__parameters:
    update_rate: {update_rate}{types}
{sections}"""


def load(
    folder: Path, urdf: str, controllers: str | None = None, **options: Any
) -> ad.Robot:
    """Load a robot from its texts through files, as a user does."""
    file = folder / "robot.urdf"
    file.write_text(urdf, encoding="utf-8")
    files: list[Path] = []
    if controllers is not None:
        files.append(folder / "controllers.yaml")
        files[0].write_text(controllers, encoding="utf-8")
    return ad.load_robot(file, controllers=files, **options)


def at_rate_of(robot: ad.Robot, step: float) -> ad.Robot:
    """Return a robot whose manager ticks in steps [s], at most; some have 1 kHz."""
    rate = min(robot.controllers.update_rate, round(1.0 / step))
    controllers = dc.replace(robot.controllers, update_rate=rate)
    return dc.replace(robot, controllers=controllers)
