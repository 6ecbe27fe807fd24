"""Control graph of a robot: topics, controllers, interfaces, hardware, and as text.

Graphviz isn't needed for its picture, which `graph_picture` draws.
"""

from arm_drake.importing import dataclass


@dataclass(frozen=True)
class ControllerNode:
    """A controller, and what it is connected to."""

    name: str

    # Its ros2_control type.
    type: str

    # "active", "inactive" or "unconfigured".
    state: str

    # Topics that it listens to and publishes.
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    # Full names of the hardware's interfaces that it reads and claims.
    reads: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()

    # Other controllers whose references it commands.
    followers: tuple[str, ...] = ()


@dataclass(frozen=True)
class HardwareNode:
    """A hardware component with its interfaces."""

    name: str

    # Lines that describe it.
    notes: tuple[str, ...] = ()

    # Full names.
    states: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()


@dataclass(frozen=True)
class ControlGraph:
    """Controllers and hardware of a robot."""

    robot: str
    controllers: tuple[ControllerNode, ...]
    hardware: tuple[HardwareNode, ...]

    # What is true of all of the hardware, such as joints that nothing commands.
    notes: tuple[str, ...] = ()


def make_dot(graph: ControlGraph) -> str:
    """Return a graph in Graphviz's language."""
    lines = [
        f"digraph {_quote(graph.robot)} {{",
        "  rankdir=LR;",
        "  node [shape=box, fontname=Helvetica];",
    ]
    for block in graph.hardware:
        own = _quote(f"hardware {block.name}")
        label = _quote("\n".join((block.name, *block.notes)))
        lines.append(f"  {own} [label={label}];")
        for name in block.states:
            interface = _quote(f"state {name}")
            lines.append(f"  {interface} [label={_quote(name)}, style=rounded];")
            lines.append(f"  {own} -> {interface};")
        for name in block.commands:
            interface = _quote(f"command {name}")
            lines.append(f"  {interface} [label={_quote(name)}, style=rounded];")
            # Not a reason to put the hardware on the right.
            lines.append(f"  {interface} -> {own} [constraint=false];")
    for controller in graph.controllers:
        own = _quote(f"controller {controller.name}")
        label = f"{controller.name}: {controller.state}\n{controller.type}"
        style = "solid" if controller.state == "active" else "dashed"
        lines.append(f"  {own} [label={_quote(label)}, style={style}];")
        for kind, topics in (("in", controller.inputs), ("out", controller.outputs)):
            for topic in topics:
                node = _quote(f"{kind} {controller.name}.{topic}")
                label = _quote(f"{controller.name}.{topic}")
                lines.append(f"  {node} [label={label}, shape=plaintext];")
                ends = (node, own) if kind == "in" else (own, node)
                lines.append(f"  {' -> '.join(ends)};")
        for name in controller.reads:
            lines.append(f"  {_quote(f'state {name}')} -> {own};")
        for name in controller.commands:
            lines.append(f"  {own} -> {_quote(f'command {name}')};")
        for name in controller.followers:
            lines.append(f"  {own} -> {_quote(f'controller {name}')};")
    notes = "\n".join((graph.robot, *graph.notes))
    return "\n".join([*lines, f"  label={_quote(notes)};", "}", ""])


def _quote(text: str) -> str:
    text = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'
