"""The ROS messages that controllers exchange, as frozen dataclasses.

Names and fields are those of the messages of the same name in `builtin_interfaces`,
`std_msgs`, `geometry_msgs`, `nav_msgs`, `sensor_msgs`, `trajectory_msgs`,
`control_msgs` and `controller_manager_msgs`. Sequences become tuples; a time may be
given as seconds. A message never changes and copies as itself, for a Drake Context
copies its abstract values often. What a user sends is checked where it is made and
raises ValueError; what controllers tell at every tick is taken as it is.
"""

from arm_drake.messages import base, control, geometry, sensors, trajectories
from arm_drake.messages.base import *  # noqa: F403
from arm_drake.messages.control import *  # noqa: F403
from arm_drake.messages.geometry import *  # noqa: F403
from arm_drake.messages.sensors import *  # noqa: F403
from arm_drake.messages.trajectories import *  # noqa: F403

# All of these, and not the modules that they come from.
__all__ = sorted(
    name
    for module in (base, control, geometry, sensors, trajectories)
    for name in module.__all__
)
