"""Event handlers of `launch`: actions that follow the start or end of others."""

from typing import Any

from arm_drake.launch.substitutions import LaunchContext, perform


class Event:
    """Event of a process, as handlers get it, or one that is emitted."""

    def __init__(self, **fields: Any) -> None:
        """Take what describes it."""
        vars(self).update(fields)


class EventHandler:
    """Entities that follow an event of an action."""

    # Which event, and the argument that says what follows.
    kind = argument = ""

    def __init__(self, *, target_action: Any = None, **kwargs: Any) -> None:
        """Take the action, or actions, whose event it is; of all, if there is none."""
        self.target, self.entities = target_action, kwargs.get(self.argument, ())

    def matches(self, action: Any) -> bool:
        """Return whether it is the event of this action."""
        if self.target is None:
            return True
        if hasattr(self.target, "visit"):  # One action.
            return self.target is action
        if callable(self.target):
            return bool(self.target(action))
        return any(each is action for each in self.target)


class OnProcessExit(EventHandler):
    kind, argument = "exit", "on_exit"


class OnProcessStart(EventHandler):
    kind, argument = "start", "on_start"


class OnExecutionComplete(EventHandler):
    kind, argument = "complete", "on_completion"


class OnShutdown(EventHandler):
    kind = "shutdown"


class OnProcessIO(EventHandler):
    kind = "output"


def entities_after(entities: Any, action: Any, context: LaunchContext) -> Any:
    """Return the entities after an event of an action; a function takes the event."""
    if not callable(entities) or hasattr(entities, "visit"):
        return entities
    own = getattr(action, "executable", None)
    command = [own] if own else getattr(action, "cmd", ())
    words = [perform(context, word) for word in command]
    event = Event(
        action=action,
        process_name=f"{words[0].rpartition('/')[2]}-1" if words else "",
        cmd=words,
        cwd=None,
        env=None,
        pid=0,
        # What ends here does so well.
        returncode=0,
    )
    return entities(event, context)
