"""Rollouts as bags of ROS 2 messages, in an `.mcap` file."""

from pathlib import Path

from arm_drake.messages import NANOSECONDS
from arm_drake.rollout.bag_messages import LATCHED, BagMessage, stamp
from arm_drake.rollout.bag_topics import RobotTopics
from arm_drake.rollout.mcap import McapFile
from arm_drake.rollout.rollout import Rollout
from arm_drake.rollout.ros_types import load_types

_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


class BagWriter:
    """Writes rollouts of one or several robots, part by part, into one file."""

    def __init__(self, path: Path) -> None:
        """Create the file, in place of one that is there.

        Args:
            path: File to write.

        Raises:
            MissingExtraError: If rosbags isn't installed.
        """
        self._types = load_types()
        # It comes with rosbags.
        import zstandard

        compressor = zstandard.ZstdCompressor(level=3)
        self._file = McapFile(path, compress=compressor.compress, compression="zstd")
        self._channels: dict[str, int] = {}
        self._robots: dict[str, RobotTopics] = {}
        self._clock_ns = -1

    def write(self, *rollouts: Rollout) -> None:
        """Write what is new, so that the file is complete up to here.

        Args:
            rollouts: Each goes on where the last one of the same robot ended; rows that
                it had are left out.
        """
        messages: list[BagMessage] = []
        for rollout in rollouts:
            topics = self._robots.setdefault(rollout.namespace, RobotTopics())
            messages += topics.tell(rollout)
            for time in rollout.time:
                time_ns = round(float(time) * NANOSECONDS)
                if time_ns > self._clock_ns:
                    self._clock_ns = time_ns
                    fields = {"clock": stamp(time_ns)}
                    messages.append(BagMessage("/clock", _CLOCK_TYPE, time_ns, fields))
        for message in sorted(messages, key=lambda message: message.time_ns):
            data = self._types.encode(message.type, message.fields)
            self._file.write(self._channel(message), message.time_ns, data)
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _channel(self, message: BagMessage) -> int:
        if message.topic not in self._channels:
            is_latched = message.topic.endswith(LATCHED)
            qos = _QOS.format(
                depth=1 if is_latched else 10,
                durability="transient_local" if is_latched else "volatile",
            )
            self._channels[message.topic] = self._file.add_channel(
                message.topic,
                message.type,
                self._types.schema(message.type),
                {
                    "offered_qos_profiles": qos,
                    "topic_type_hash": self._types.hash(message.type),
                },
            )
        return self._channels[message.topic]


def write_mcap(rollout: Rollout, path: Path) -> None:
    """Write all of a rollout.

    Args:
        rollout: The rollout.
        path: File to write.
    """
    writer = BagWriter(path)
    try:
        writer.write(rollout)
    finally:
        writer.close()
