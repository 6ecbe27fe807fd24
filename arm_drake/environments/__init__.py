"""Environments of Gymnasium: robots that learn, under their own controllers.

Importing it registers `ArmDrake/Reach-v0`; so does
`gymnasium.make("arm_drake.environments:ArmDrake/Reach-v0", robot=...)`.
"""

from arm_drake.errors import MissingExtraError

try:
    import gymnasium
except ImportError:
    raise MissingExtraError("an environment", "gym") from None

gymnasium.register(
    id="ArmDrake/Reach-v0", entry_point="arm_drake.environments.environment:make_env"
)
