"""Expansion of parts that are repeated in series (`repeat:`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from heavebond.core.errors import Problems
from heavebond.core.limits import OF_A_KIND
from heavebond.language.definition import Body, Component, End, Instance, Value, Wire
from heavebond.text.shapes import whole_number


def repeated(body: Body, numbers: Mapping[str, int], opened: Callable[[Instance], Component | None], problems: Problems
             ) -> Body:
    """The body with each part that is repeated as parts `name_1` to `name_n`, port b of one joined to port a of the next;
    `numbers` are the whole numbers that `repeat:` may name, `opened` gives the component that a part is."""
    if not any(i.repeat for i in body.instances.values()):
        return body
    instances: dict[str, Instance] = {}
    wires = dict(body.wires)
    ends: dict[str, str] = {}
    for instance in body.instances.values():
        if instance.repeat is None or not _in_line(instance, instance.repeat, opened(instance), problems):
            instances[instance.name] = instance
            continue
        count = _count(instance.repeat, numbers, problems)
        for k in range(1, count + 1):
            part = replace(instance, name=f"{instance.name}_{k}", repeat=None)
            _check_free(part.name, instance, body.instances, instances, problems)
            instances[part.name] = part
            if k < count:
                link = f"{instance.name}_{k}_{k + 1}"
                joined: tuple[End, ...] = ()
                if link in wires and wires[link].place.file == "with_component":  # joined to it from without
                    joined = wires[link].ends
                else:
                    _check_free(link, instance, body.wires, wires, problems)
                wires[link] = Wire(link, (End(f"{instance.name}_{k}.b", instance.place),
                                          End(f"{instance.name}_{k + 1}.a", instance.place), *joined), instance.place)
        ends[f"{instance.name}.a"] = f"{instance.name}_1.a"
        ends[f"{instance.name}.b"] = f"{instance.name}_{count}.b"
    wires = {n: replace(w, ends=tuple(replace(e, path=ends.get(e.path, e.path)) for e in w.ends))
             for n, w in wires.items()}
    return Body(instances, wires, layout=body.layout)


def _check_free(name: str, instance: Instance, written: Mapping[str, Instance | Wire], made: Mapping[str, Instance | Wire],
                problems: Problems) -> None:
    """A name that `repeat:` makes is neither written in the file nor made by another `repeat:`."""
    existing = written.get(name) or made.get(name)
    if existing is not None:
        noun = "component" if isinstance(existing, Instance) else "node"
        problems.add("name-twice", f"`repeat:` makes a {noun} '{name}' of '{instance.name}' (line {instance.place.line}); "
                     f"there is one already (line {existing.place.line})", existing.place,
                     hint=f"Give the {noun} '{name}' or '{instance.name}' another name.")


def _in_line(instance: Instance, repeat: Value, component: Component | None, problems: Problems) -> bool:
    """True if a part has the two ports a and b that a series needs."""
    if component is None:
        return False
    single = [name for name in ("a", "b") if (port := component.ports.get(name)) is not None and port.count is None]
    if len(single) < 2:
        problems.add("repeat-ports", f"'{instance.name}' ({component.name}) cannot be repeated in line: that takes "
                     "two single ports called a and b", repeat.place, hint="Write each of them by itself.")
    return len(single) == 2


def _count(repeat: Value, numbers: Mapping[str, int], problems: Problems) -> int:
    """The number of repetitions; 1, and a problem, if it is invalid."""
    count = whole_number(repeat.expr, numbers)
    if count is None or count < 1:
        problems.add("not-an-integer", f"repeat must be a whole number above 0, '{repeat.text}' is none", repeat.place,
                     hint="Write for example `repeat: 10`, or a parameter: `repeat: =n`.")
        return 1
    if count > OF_A_KIND:
        problems.add("not-an-integer", f"repeat: {count} is too many", repeat.place, hint=f"The most is {OF_A_KIND}.")
        return 1
    return count
