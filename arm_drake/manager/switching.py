"""Switches of controllers: chains, the order of updates, and what a request leads to.

A controller that claims a reference interface of another is its predecessor, the other
one its follower. The rules are those of ros2_control's controller_manager
(``switch_controller``, ``check_following_controllers_for_activate``,
``check_preceeding_controllers_for_deactivate``), and of its service
``controller_manager_msgs/SwitchController``.
"""

import dataclasses as dc
import itertools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

from arm_drake.errors import suggest
from arm_drake.importing import dataclass


@dataclass(frozen=True)
class ControllerInfo:
    """Data of a controller for the manager's switches."""

    name: str

    # Full names of what it claims: "joint1/position", or "pid/joint1/position" for a
    # reference interface of controller "pid".
    command_interfaces: tuple[str, ...] = ()

    # Full names of what it reads.
    state_interfaces: tuple[str, ...] = ()

    # Full names of what it exports, "<its name>/...".
    reference_interfaces: tuple[str, ...] = ()
    exported_state_interfaces: tuple[str, ...] = ()

    # Those of what it claims that limit a joint's "effort" or "velocity", by name.
    limit_interfaces: Mapping[str, str] = dc.field(default_factory=dict)

    # Joints of hardware that follows one controller at a time, by whatever interface.
    joints: tuple[str, ...] = ()

    # Whether it is inactive or active; else it can't be activated.
    is_configured: bool = True

    # Why it can't be activated, such as interfaces that don't exist.
    missing: tuple[str, ...] = ()


def activation_order(
    controllers: Mapping[str, ControllerInfo], names: Iterable[str]
) -> tuple[str, ...]:
    """Return names so that each comes after those that it needs to be active."""
    owners = interface_owners(controllers)
    return order(names, {n: needs_of(c, owners) for n, c in controllers.items()})


def chain_of(
    controllers: Mapping[str, ControllerInfo], active: Collection[str], name: str
) -> tuple[str, ...]:
    """Return a controller and the active ones that it is chained with."""
    before = _predecessors(controllers)
    chain, waiting = [name], [name]
    while waiting:
        this = waiting.pop()
        for other in active:
            is_linked = other in before[this] or this in before[other]
            if is_linked and other not in chain:
                chain.append(other)
                waiting.append(other)
    return tuple(chain)


def find_cycle(controllers: Mapping[str, ControllerInfo]) -> str:
    """Return what is wrong with controllers that need each other in a circle.

    None of them could be activated, for each needs the next one to be active. It is ""
    if there is no circle.
    """
    owners = interface_owners(controllers)
    needs = {name: needs_of(info, owners) for name, info in controllers.items()}
    for name in controllers:
        path = [name]
        seen = {name}
        while path:
            onward = [n for n in needs[path[-1]] if n == name or n not in seen]
            if not onward:
                path.pop()
                continue
            if onward[0] == name:
                return _describe_cycle([*path, name], controllers, needs)
            path.append(onward[0])
            seen.add(onward[0])
    return ""


def _describe_cycle(
    path: Sequence[str],
    controllers: Mapping[str, ControllerInfo],
    needs: Mapping[str, Mapping[str, str]],
) -> str:
    """Return what is wrong with a circle whose first controller is its last, too."""
    links = list(itertools.pairwise(path))
    if all(
        needs[name][other] in controllers[name].command_interfaces
        for name, other in links
    ):
        names = " -> ".join(map(repr, path))
        return (
            f"controllers command each other in a circle: {names}; "
            "expected chains that end at the hardware"
        )
    needed = ", ".join(
        f"{name!r} needs {needs[name][other]!r}" for name, other in links
    )
    return (
        f"controllers wait for each other in a circle: {needed}; "
        "expected chains that end at the hardware"
    )


def chained(
    controllers: Mapping[str, ControllerInfo], active: Collection[str]
) -> frozenset[str]:
    """Return those active controllers that another active one commands."""
    return frozenset(
        name
        for name, predecessors in _predecessors(controllers).items()
        if name in active and any(p in active and p != name for p in predecessors)
    )


def interface_owners(controllers: Mapping[str, ControllerInfo]) -> dict[str, str]:
    """Return which controller exports an interface."""
    return {
        interface: name
        for name, info in controllers.items()
        for interface in (*info.reference_interfaces, *info.exported_state_interfaces)
    }


def needs_of(info: ControllerInfo, owners: Mapping[str, str]) -> dict[str, str]:
    """Return whom a controller needs to be active, and by which interface."""
    found: dict[str, str] = {}
    for interface in (*info.command_interfaces, *info.state_interfaces):
        if interface in owners:
            found.setdefault(owners[interface], interface)
    return found


def order(names: Iterable[str], before: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    """Return names so that each comes after those that are to be before it."""
    requested = dict.fromkeys(names)
    found: dict[str, None] = {}
    entered = set()

    def visit(name: str) -> None:
        # In a circle, who is entered first comes last.
        if name in requested and name not in entered:
            entered.add(name)
            for other in before[name]:
                visit(other)
            found[name] = None

    for name in requested:
        visit(name)
    return tuple(found)


def _predecessors(controllers: Mapping[str, ControllerInfo]) -> dict[str, list[str]]:
    """Return who commands each controller."""
    owners = {
        interface: name
        for name, info in controllers.items()
        for interface in info.reference_interfaces
    }
    found: dict[str, list[str]] = {name: [] for name in controllers}
    for name, info in controllers.items():
        for owner in dict.fromkeys(owners.get(i, "") for i in info.command_interfaces):
            if owner:
                found[owner].append(name)
    return found


@dataclass(frozen=True)
class SwitchPlan:
    """Plan of a switch."""

    # Controllers to activate, followers before their predecessors, and to deactivate,
    # predecessors before their followers; one that is in both restarts.
    activate: tuple[str, ...]
    deactivate: tuple[str, ...]

    # What the service returns.
    ok: bool

    # What could not be done, and why.
    problems: tuple[str, ...]

    # Controllers that stay active, but enter or leave the chained mode: upstream
    # deactivates and activates them in the same switch.
    restart: tuple[str, ...] = ()


def plan_switch(
    controllers: Mapping[str, ControllerInfo],
    active: Collection[str],
    activate: Sequence[str],
    deactivate: Sequence[str],
    *,
    strict: bool,
    is_humble: bool = False,
) -> SwitchPlan:
    """Return the plan of a requested switch of controllers.

    Strict: if there is any problem, nothing happens, and the result isn't ok.

    Best effort: controllers with a problem are left out, also those that need one that
    is left out. Being active or inactive already is no failure. As the service says
    since jazzy, the result is not ok if all controllers to activate fail, or all to
    deactivate, even if something was done; if all of either are unknown, nothing is
    done. In humble it is ok whatever fails (ros2_control, pull request 2060). Of two
    that claim the same interface the first gets it.

    A follower can be deactivated only if none of its predecessors stays active, also if
    it is activated again in the same switch: one that is in both lists restarts.
    Nothing asked for is ok.
    """
    switch = _Switch(controllers, active, activate, deactivate)
    if strict:
        switch.find_problems()
    else:
        switch.take_out_problems()
    problems = tuple(switch.problems)
    if (switch.has_unknown_list and not is_humble) or (strict and problems):
        return SwitchPlan((), (), False, problems)
    owners = interface_owners(controllers)
    needs = {name: tuple(needs_of(c, owners)) for name, c in controllers.items()}
    users = {
        name: [user for user, needed in needs.items() if name in needed]
        for name in controllers
    }
    after = switch.active_after
    changed = chained(controllers, active) ^ chained(controllers, after)
    stay = set(active) & after - set(switch.activate)
    return SwitchPlan(
        activate=order(switch.activate, needs),
        deactivate=order(switch.deactivate, users),
        ok=is_humble or switch.is_ok,
        problems=problems,
        restart=tuple(name for name in controllers if name in changed & stay),
    )


class _Switch:
    """A request, from which is taken what can't be done."""

    def __init__(
        self,
        controllers: Mapping[str, ControllerInfo],
        active: Collection[str],
        activate: Sequence[str],
        deactivate: Sequence[str],
    ) -> None:
        self._controllers = controllers
        self._active = set(active)
        self._owners = interface_owners(controllers)
        self.problems: list[str] = []
        # Asked for, and what of it is still to be done.
        self._requested = (activate, deactivate)
        self.activate, self.deactivate = (
            [name for name in dict.fromkeys(names) if name in controllers]
            for names in self._requested
        )
        self.has_unknown_list = any(
            names and not known
            for names, known in zip(
                self._requested, (self.activate, self.deactivate), strict=True
            )
        )
        for name in dict.fromkeys((*activate, *deactivate)):
            if name not in controllers:
                hint = suggest(name, controllers)
                self.problems.append(f"no controller {name!r}; {hint}")

    @property
    def active_after(self) -> set[str]:
        """Controllers that are active after the switch."""
        return self._active - set(self.deactivate) | set(self.activate)

    @property
    def is_ok(self) -> bool:
        """Whether something of each list is done, or was so already."""
        activate, deactivate = self._requested
        idle = {
            name
            for name, info in self._controllers.items()
            if name not in self._active and info.is_configured
        }
        return not self.has_unknown_list and all(
            not requested or any(name in done for name in requested)
            for requested, done in (
                (activate, self.active_after),
                (deactivate, {*self.deactivate, *idle}),
            )
        )

    def find_problems(self) -> None:
        """Find what is wrong with the request as a whole."""
        for names, check in self._checks():
            for name in names:
                self.problems += check(name)

    def take_out_problems(self) -> None:
        """Take out what can't be done, one after the other.

        What is taken out can make something else impossible.
        """
        while self._take_out_one():
            pass

    def _take_out_one(self) -> bool:
        for names, check in self._checks():
            for name in names:
                problems = list(check(name))
                if problems:
                    self.problems += problems
                    names.remove(name)
                    return True
        return False

    def _checks(self) -> Iterator[tuple[list[str], Callable[[str], Iterator[str]]]]:
        # What stays active matters to what is activated, but not the other way round;
        # and only what could be activated by itself takes an interface from another.
        yield self.deactivate, self._objections_to_deactivate
        yield self.activate, self._objections_to_activate
        yield self.activate, self._objections_within_request

    def _objections_to_deactivate(self, name: str) -> Iterator[str]:
        what = f"could not deactivate {name!r}"
        if name not in self._active:
            state = "active" if self._controllers[name].is_configured else "configured"
            yield f"{what}: it is not {state}"
        for other in self._controllers:
            if other in self._active and other not in self.deactivate:
                for owner, interface in self._needs_of(other).items():
                    if owner == name and other != name:
                        yield (
                            f"{what}: {other!r}, which uses {interface!r}, stays active"
                        )

    def _objections_to_activate(self, name: str) -> Iterator[str]:
        what, info = f"could not activate {name!r}", self._controllers[name]
        if not info.is_configured:
            yield f"{what}: it is not configured"
            return
        if name in self._active and name not in self.deactivate:
            yield f"{what}: it is already active"
            return
        for text in info.missing:
            yield f"{what}: {text}"
        after = self.active_after
        for owner, interface in self._needs_of(name).items():
            if owner not in after:
                is_active = owner in self._active
                state = "is to be deactivated" if is_active else "is not active"
                yield f"{what}: {interface!r} belongs to {owner!r}, which {state}"
        for other in self._controllers:
            if other in self._active and other not in self.deactivate:
                yield from self._conflicts(name, other, "which stays active")

    def _objections_within_request(self, name: str) -> Iterator[str]:
        for other in self.activate[: self.activate.index(name)]:
            yield from self._conflicts(name, other, "which is activated too")

    def _conflicts(self, name: str, other: str, state: str) -> Iterator[str]:
        claimed = self._controllers[other].command_interfaces
        for interface in self._controllers[name].command_interfaces:
            if interface in claimed:
                yield (
                    f"could not activate {name!r}: {interface!r} is claimed by "
                    f"{other!r}, {state}"
                )
                return
        joints = self._controllers[other].joints
        for joint in self._controllers[name].joints:
            if joint in joints:
                yield (
                    f"could not activate {name!r}: joint {joint!r} is commanded by "
                    f"{other!r}, {state}"
                )
                return

    def _needs_of(self, name: str) -> dict[str, str]:
        """Return whom a controller needs, and by which interface."""
        return needs_of(self._controllers[name], self._owners)
