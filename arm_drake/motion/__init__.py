"""Motion files: what is sent to the controllers, and when; see `docs/motions.md`."""

from arm_drake.motion.files import load_motion, parse_motion
from arm_drake.motion.timeline import Motion, MotionStep, StepMessage, TopicMessage

__all__ = [
    "Motion",
    "MotionStep",
    "StepMessage",
    "TopicMessage",
    "load_motion",
    "parse_motion",
]
