"""Event handlers of `launch`: actions that follow the start or end of others."""

from typing import Any

from arm_drake.launch.substitutions import LaunchContext, perform


class Event:
    """An event, of which only its kind matters."""

    def __init__(self, **fields: Any) -> None:
        """Take what describes it."""
        vars(self).update(fields)


class EventHandler:
    """What follows an event of an action."""

    # Actions whose event it is: of all, if there is none.
    target: Any = None
    entities: Any = ()
    kind = ""

    def __init__(self, **kwargs: Any) -> None:
        """Take what describes it."""
        self.kwargs = kwargs

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
    kind = "exit"

    def __init__(
        self, *, target_action: Any = None, on_exit: Any = (), **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.target, self.entities = target_action, on_exit


class OnProcessStart(EventHandler):
    kind = "start"

    def __init__(
        self, *, target_action: Any = None, on_start: Any = (), **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.target, self.entities = target_action, on_start


class OnExecutionComplete(EventHandler):
    kind = "complete"

    def __init__(
        self, *, target_action: Any = None, on_completion: Any = (), **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.target, self.entities = target_action, on_completion


class OnShutdown(EventHandler):
    kind = "shutdown"


class OnProcessIO(EventHandler):
    kind = "output"


def entities_after(entities: Any, action: Any, context: LaunchContext) -> Any:
    """Return what follows an event of an action; a function is told the event."""
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
