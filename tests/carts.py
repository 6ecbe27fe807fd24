"""A small base with two wheels and a caster, driven by plugins of Gazebo."""

from pathlib import Path
from typing import Any

import arm_drake as ad

# Measures of the cart [m].
SEPARATION, RADIUS = 0.4, 0.1

_SIDES = (("left_joint", "left"), ("right_joint", "right"))
_MEASURES = (*_SIDES, ("wheel_separation", SEPARATION))

GZ, CLASSIC = "gz-sim-diff-drive-system", "libgazebo_ros_diff_drive.so"


def diff_drive(*tags: tuple[str, object], name: str = "drive") -> str:
    """Return Gazebo's plugin that drives the cart, with further tags."""
    return _plugin(GZ, name, (*_MEASURES, ("wheel_radius", RADIUS), *tags))


def classic_drive(*tags: tuple[str, object]) -> str:
    """Return that of Gazebo Classic."""
    more = (("wheel_diameter", 2.0 * RADIUS), ("publish_odom", "true"), *tags)
    return _plugin(CLASSIC, "drive", (*_MEASURES, *more))


def plugin(filename: str, *tags: tuple[str, object]) -> str:
    """Return a plugin with these tags alone."""
    return _plugin(filename, "drive", tags)


def _plugin(filename: str, name: str, tags: tuple[tuple[str, object], ...]) -> str:
    inside = "".join(f"<{tag}>{text}</{tag}>" for tag, text in tags)
    text = f'<plugin filename="{filename}" name="{name}">{inside}</plugin>'
    return f"<gazebo>{text}</gazebo>"


def _inertial(mass: float, inertia: float, xyz: str = "0 0 0") -> str:
    moments = " ".join(f'{axis}="{inertia}"' for axis in ("ixx", "iyy", "izz"))
    return f"""<inertial><origin xyz="{xyz}"/><mass value="{mass}"/>
      <inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>"""


def _wheel(name: str, y: float, limit: str) -> str:
    return f"""
  <link name="{name}_wheel">{_inertial(0.5, 0.0025)}
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="{RADIUS}" length="0.04"/></geometry></collision>
  </link>
  <joint name="{name}" type="continuous">
    <parent link="base_link"/><child link="{name}_wheel"/>
    <origin xyz="0 {y} {RADIUS}"/><axis xyz="0 1 0"/>{limit}
  </joint>"""


def cart(*blocks: str, limit: str = "") -> str:
    """Return a cart of 6.2 kg.

    Args:
        blocks: What else the description has, such as plugins.
        limit: `<limit>` of the wheels' joints.
    """
    return f"""
<robot name="cart">
  <link name="base_link">{_inertial(5.0, 0.05, "-0.02 0 0.1")}
    <collision><origin xyz="0 0 0.15"/>
      <geometry><box size="0.3 0.3 0.1"/></geometry></collision>
  </link>
  <link name="caster">{_inertial(0.2, 0.0002)}
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="caster" type="fixed">
    <parent link="base_link"/><child link="caster"/><origin xyz="-0.2 0 0.05"/>
  </joint>
  {_wheel("left", SEPARATION / 2.0, limit)}{_wheel("right", -SEPARATION / 2.0, limit)}
  {"".join(blocks)}
</robot>"""


def load(folder: Path, text: str, **options: Any) -> ad.Robot:
    """Return a robot of this description.

    Args:
        folder: Where to write it.
        text: The URDF.
        options: Of `load_robot`.
    """
    path = folder / "cart.urdf"
    path.write_text(text, encoding="utf-8")
    return ad.load_robot(path, **options)


# Distance of the axles of the steered cart [m].
WHEEL_BASE = 0.5


def _steered_wheel(name: str, y: float) -> str:
    turning = _wheel(f"front_{name}", 0.0, "").replace("base_link", f"{name}_knuckle")
    return f"""
  <link name="{name}_knuckle">{_inertial(0.2, 0.0005)}</link>
  <joint name="{name}_steering" type="revolute">
    <parent link="base_link"/><child link="{name}_knuckle"/>
    <origin xyz="{WHEEL_BASE} {y} 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="20" velocity="20"/>
  </joint>{turning}"""


def steered_cart(*blocks: str) -> str:
    """Return a cart of 10 kg that drives by its rear wheels and steers by others."""
    half = SEPARATION / 2.0
    return f"""
<robot name="cart">
  <link name="base_link">{_inertial(7.6, 0.2, "0.2 0 0.1")}
    <collision><origin xyz="0.2 0 0.2"/>
      <geometry><box size="0.3 0.2 0.1"/></geometry></collision>
  </link>
  {_wheel("left", half, "")}{_wheel("right", -half, "")}
  {_steered_wheel("left", half)}{_steered_wheel("right", -half)}
  {"".join(blocks)}
</robot>"""


def ackermann_steering(*tags: tuple[str, object]) -> str:
    """Return Gazebo's plugin that drives the steered cart, with further tags."""
    steering = tuple(
        (f"{s}_steering_joint", f"{s}_steering") for s in ("left", "right")
    )
    measures = (("wheel_base", WHEEL_BASE), ("kingpin_width", SEPARATION))
    more = (*steering, *measures, ("wheel_radius", RADIUS), *tags)
    name = "gz-sim-ackermann-steering-system"
    return _plugin(name, "gz::sim::systems::AckermannSteering", (*_MEASURES, *more))


def classic_ackermann(*tags: tuple[str, object]) -> str:
    """Return Gazebo Classic's plugin that drives it, with further tags."""
    joints = (
        *(("front_right_joint", "front_right"), ("front_left_joint", "front_left")),
        *(("rear_right_joint", "right"), ("rear_left_joint", "left")),
        ("right_steering_joint", "right_steering"),
        ("left_steering_joint", "left_steering"),
    )
    gains = (
        ("right_steering_pid_gain", "20 0 0.5"),
        ("left_steering_pid_gain", "20 0 0.5"),
        ("linear_velocity_pid_gain", "1 2 0"),
        ("linear_velocity_i_range", "-20 20"),
    )
    more = (*joints, *gains, ("publish_odom", "true"), *tags)
    return _plugin("libgazebo_ros_ackermann_drive.so", "drive", more)
