"""Who commands whom among controllers, and the order of their updates.

The rules are those of ros2_control's controller_manager. A controller that claims a
reference interface of another is its predecessor, the other one its follower.
"""

import dataclasses as dc
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence


@dc.dataclass(frozen=True)
class ControllerInfo:
    """What the manager has to know of a controller to switch it."""

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
    """Return names so that each comes after those that it needs to be active.

    Args:
        controllers: All controllers that are loaded, by name.
        names: Controllers to activate.
    """
    owners = interface_owners(controllers)
    return order(names, {n: needs_of(c, owners) for n, c in controllers.items()})


def chain_of(
    controllers: Mapping[str, ControllerInfo], active: Collection[str], name: str
) -> tuple[str, ...]:
    """Return a controller and the active ones that it is chained with.

    Args:
        controllers: All controllers that are loaded, by name.
        active: Names of those that are active.
        name: Name of the controller.
    """
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

    Args:
        controllers: All controllers that are loaded, by name.
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
    """Return those active controllers that another active one commands.

    Args:
        controllers: All controllers that are loaded, by name.
        active: Names of those that are active.
    """
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
    wanted = dict.fromkeys(names)
    found: dict[str, None] = {}
    entered = set()

    def visit(name: str) -> None:
        # In a circle, who is entered first comes last.
        if name in wanted and name not in entered:
            entered.add(name)
            for other in before[name]:
                visit(other)
            found[name] = None

    for name in wanted:
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
