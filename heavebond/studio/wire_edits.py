"""Edits of wires: join ports, remove them from their nodes, and the reason why two ports cannot be joined."""

from __future__ import annotations

import re

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.studio.diagram_edits import Diagram, Entry, free_name, renamed_mentions, with_entry, without_node
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import add_item, delete_entry

SIGNAL = "signal"


def join_ports(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Join two ports on one node: a new one, the node of either, or both nodes merged."""
    one, two = str(action["from"]), str(action["to"])
    for reason in filter(None, [why_not(diagram, one, two)]):
        raise UsageError([Problem("ports-unfit", reason)])
    first, second = diagram.node_of(one), diagram.node_of(two)
    if not first and not second:
        name = node_name(diagram, (one, two))
        return {"text": with_entry(diagram.text, "nodes", name, [one, two]), "node": name}
    if first and second:
        # move the ports of the second node to the first, and replace the second's name in formulas
        ends = diagram.section("nodes").get(second)
        if "extends" in diagram.root or not isinstance(ends, list):
            raise UsageError([Problem("edit-refused",
                                      f"'{first}' and '{second}' are nodes of the diagram that this one extends", None,
                                      "Join them there.")])
        text = delete_entry(renamed_mentions(diagram.text, diagram.named(second), first, node=True), ("nodes", second))
        for end in ends:
            text = add_item(text, ("nodes", first), str(end))
        return {"text": text, "node": first}
    node, port = (first, two) if first else (second, one)
    inherited = node not in diagram.section("nodes")
    return {"text": add_item(diagram.text, ("nodes", node), f"+{port}" if inherited or "extends" in diagram.root else port),
            "node": node}


def node_name(diagram: Diagram, ports: tuple[str, str]) -> str:
    """A name for a new node: the name of a part with one power port, a mass or a source, whose variables have other names
    than the variables of the node; else `part_port` of the output, or of the first port."""
    parts = list(dict.fromkeys(port.partition(".")[0] for port in ports))
    domain = diagram.model.library.domains.get(next(filter(None, (_port_facts(diagram, port)[0] for port in ports)), ""))
    if domain is not None:
        members = {*domain.members}
        for part in parts:
            single = part in diagram.expanded.leaves and len(diagram.expanded.leaves[part].component.ports) == 1
            if single and part not in diagram.model.body.wires and not members & diagram.named(part).members:
                return part
    named = next((port for port in ports if _port_facts(diagram, port)[1]), ports[0])
    return free_name(re.sub(r"\W+", "_", named).strip("_"), diagram.used_names)


def leave_node(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Remove a port from its node; the node is removed with its last port."""
    port = str(action["port"])
    node = diagram.node_of(port)
    ends = diagram.section("nodes").get(node)
    if not node or not isinstance(ends, list) or port not in [str(end).lstrip("+") for end in ends]:
        raise UsageError([Problem("edit-refused", f"'{port}' is on no node of this file")])
    if len(ends) == 1:
        return {"text": without_node(diagram, node)}
    k = [str(end).lstrip("+") for end in ends].index(port)
    return {"text": delete_entry(diagram.text, ("nodes", node, k)), "node": node}


def why_not(diagram: Diagram, one: str, two: str) -> str:
    """Reason why two ports cannot be joined; empty if they can."""
    if one == two:
        return "a wire joins two ports"
    facts = [_port_facts(diagram, port) for port in (one, two)]
    (first, out), (second, drives) = facts
    node = diagram.node_of(one)
    if node and node == diagram.node_of(two):
        return f"'{one}' and '{two}' are joined already, on node '{node}'"
    if SIGNAL in (first, second) and first != second:
        return (f"'{one}' is {_a(first)} port and '{two}' {_a(second)} port: a signal acts through a source (ForceSource, "
                "FlowSource, ...) and comes from a sensor")
    if first and second and first != second:
        return (f"'{one}' is {_a(first)} port and '{two}' {_a(second)} port. Find a component that couples the two "
                f"domains by `heavebond library` with the words '{first} {second}'")
    if out and drives:
        return f"'{one}' and '{two}' are both outputs; a signal has exactly one. Add them with a Sum"
    for port in (one, two):
        part, _, name = port.partition(".")
        leaf = diagram.expanded.leaves.get(part)
        if leaf is not None and name in leaf.inputs and port not in diagram.expanded.defaults:
            value = leaf.inputs[name].value
            value_text = getattr(value, "text", "") or getattr(value, "file", "")
            return f"'{port}' has a value in place, `{name}: {value_text}`; remove that first"
    # reason about a second output on a node that has one
    outputs = []
    for port in (one, two):
        wire = diagram.model.body.wires.get(diagram.node_of(port))
        on = [end.path for end in wire.ends] if wire else [port]
        outputs += [p for p in dict.fromkeys([*on, port]) if _port_facts(diagram, p)[1]]
    return f"the signal would have two outputs, {listing(outputs)}; add them with a Sum" if len(outputs) > 1 else ""


def _a(domain: str) -> str:
    return f"{'an' if domain[:1] in 'aeiou' else 'a'} {domain or 'power'}"


def _port_facts(diagram: Diagram, path: str) -> tuple[str, bool]:
    """The domain of a port, empty if it is not known yet, and whether it is an output (for a block, seen from inside, an
    input); UsageError for an unknown port."""
    part, _, port = path.partition(".") if "." in path else ("", "", path)
    leaf = diagram.expanded.leaves.get(part)
    base = port.partition("[")[0]
    if leaf is None or (base not in leaf.component.ports and base not in leaf.component.signal_names):
        raise UsageError([Problem("port-unknown", f"there is no port '{path[:100]}'")])
    if (signal := leaf.component.signal(base)) is not None:
        return SIGNAL, signal.direction == ("out" if part else "in")
    domain = leaf.component.ports[base].domain
    return ("" if domain.startswith("$") else domain) or diagram.network.domains.get(part, {}).get(base, ""), False
