"""Diagrams that are built in Python: equal to files, with messages that show the line of the program."""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from collected import partly
from diagrams import CART

import heavebond as hb
from heavebond.language.library import bundled
from heavebond.text.python_source import plain, yaml_text
from heavebond.text.yaml_source import parse, read

SNUBBER = {
    "summary": "Force that grows with the third power of the speed.",
    "ports": {"a": "translational", "b": "translational"},
    "parameters": {"k": {"unit": "N*s**3/m**3", "doc": "coefficient", "min": 0}},
    "variables": {"w": {"unit": "m/s", "doc": "relative speed"}},
    "equations": ["w = a.v - b.v", "a.f = k*w**3  # cubic law", "a.f + b.f = 0"],
    "dissipates": "k*w**4",
}


def cart() -> hb.Diagram:
    d = hb.Diagram("cart")
    d.add("Fixed", "wall")
    d.add("Spring", "spring", c="1 kN/m")
    d.add("Damper", "damper", d="20 N*s/m")
    d.add("Mass", "cart", m="10 kg")
    d.connect("wall.a", "spring.a", "damper.a", node="wall")
    d.connect("spring.b", "damper.b", "cart.a", node="load")
    d.initial({"load.x": "20 mm", "load.v": "0 m/s"})
    d.show("place", "load.x", unit="mm")
    return d.update(simulate={"until": "1 s", "every": "0.1 s"})


def test_a_diagram_built_in_python_is_that_of_its_file(tmp_path: Path) -> None:
    built, told = cart(), hb.loads(CART)
    run, same = hb.simulate(built), hb.simulate(told)
    assert (run["load.x"] == same["load.x"]).all() and run.names() == same.names()
    path = built.save(tmp_path / "cart.yaml")
    assert hb.Diagram.read(path) == built and hb.Diagram.from_dict(built.as_dict()) == built
    assert (hb.simulate(path)["load.x"] == run["load.x"]).all()
    assert built.yaml() == path.read_text() and repr(built) == "<Diagram 'cart': 4 parts, 2 nodes, 1 output>"
    assert pickle.loads(pickle.dumps(built)) == built and built != hb.Diagram("cart")


@pytest.mark.parametrize("part", partly(range(6), 6))
def test_every_bundled_file_is_written_and_read_back(part: int) -> None:
    for path in sorted([*bundled("models").rglob("*.yaml"), *bundled("components").rglob("*.yaml")])[part::6]:
        root = read(path, bundled=True).root
        assert plain(parse(yaml_text(root), trusted=True).root) == plain(root), path


def test_every_function_takes_a_diagram() -> None:
    d = cart()
    assert hb.assemble(d).state_names == hb.assemble(hb.loads(CART)).state_names
    assert hb.draw(d) == hb.draw(d.model()) and d._repr_html_() == d.model()._repr_html_()
    wrong = hb.Diagram("x").add("Mass", "a<b")._repr_html_()
    assert wrong.startswith("<pre>") and "name-bad" in wrong and "'a&lt;b'" in wrong and "'a<b'" not in wrong
    assert hb.energy(d).result.time[-1] == 1 and len(hb.root_locus(d, "damper.d", "1 .. 20 N*s/m", points=3).values) == 3


def test_numbers_are_in_the_base_unit_of_their_parameter() -> None:
    class Quantity:
        """What is used of a quantity of pint."""

        def __init__(self, magnitude: float, units: str) -> None:
            self.magnitude, self.units = magnitude, Units(units)

    class Units(str):
        def __format__(self, spec: str) -> str:
            return str(self) if spec == "~C" else "?"

    d = hb.Diagram("numbers")
    d.add("Mass", "a", m=250).add("Mass", "b", m=np.float64(0.25)).add("Mass", "c", m=Quantity(3, "t"))
    d.add("Gain", "g", k=2).add("Constant", "k", {"k": 4})
    parts = d.as_dict()["components"]
    assert [parts[n]["m"] for n in "abc"] == ["250 kg", "0.25 kg", "3.0 t"] and parts["g"]["k"] == "2"


def test_pint_quantities_are_taken() -> None:
    pint = pytest.importorskip("pint")
    d = hb.Diagram("pint").add("Spring", "s", c=42 * pint.Unit("kN/m"))
    d.connect("s.a", node="a").connect("s.b", node="b").add("Fixed", "w").connect("w.a", "s.a")
    d.add("Mass", "m", m=3 * pint.Unit("t")).connect("m.a", "s.b")
    values = hb.assemble(d).parameter_values
    assert (values["s.c"], values["m.m"]) == (pytest.approx(42e3), pytest.approx(3e3))


def test_nodes_are_joined_and_named() -> None:
    d = hb.Diagram("nodes")
    for k in "abcd":
        d.add("Mass", k, m="1 kg")
    d.connect("a.a", "b.a").connect("c.a", "d.a")
    assert d.as_dict()["nodes"] == {"a_a": ["a.a", "b.a"], "c_a": ["c.a", "d.a"]}
    d.connect("d.a", "b.a", node="all")
    assert d.as_dict()["nodes"] == {"all": ["c.a", "d.a", "a.a", "b.a"]}
    d.remove("c").remove("a")
    assert d.as_dict()["nodes"] == {"all": ["d.a", "b.a"]} and list(d.as_dict()["components"]) == ["b", "d"]
    with pytest.raises(hb.ModelError, match="nodes-joined"):
        hb.Diagram("two").connect("a.a", node="one").connect("b.a", node="two").connect("a.a", "b.a")
    with pytest.raises(hb.UsageError, match="connect-alone"):
        hb.Diagram("one").connect("a.a")


def test_a_component_defined_in_python_is_that_of_its_file(tmp_path: Path) -> None:
    d = cart().define("Snubber", **SNUBBER)
    d.add("Snubber", "snubber", k=3e3).connect("wall.a", "snubber.a").connect("cart.a", "snubber.b")
    run = hb.simulate(d)
    path = d.save(tmp_path / "cart.yaml")
    assert (hb.simulate(path)["load.x"] == run["load.x"]).all()
    text = (tmp_path / "components" / "Snubber.yaml").read_text()
    assert "  a.f = k*w**3  # cubic law\n" in text
    lines = hb.Diagram("lines").define("Snubber", **{**SNUBBER, "equations": "\n".join(SNUBBER["equations"])})
    assert yaml_text(lines._definitions["Snubber"]) == text
    assert (pickle.loads(pickle.dumps(run))["load.x"] == run["load.x"]).all()
    assert run["load.x"][-1] != hb.simulate(cart())["load.x"][-1]


def test_a_block_and_a_variant_are_defined_in_python() -> None:
    d = cart().define("Snubber", **SNUBBER)
    d.define("StiffSnubber", extends="Snubber", summary="A stiff one.", set={"k": "9 kN*s**3/m**3"})
    d.define("Pair", summary="Two in parallel.", ports={"a": "translational", "b": "translational"},
             components={"one": {"is": "StiffSnubber"}, "two": {"is": "StiffSnubber"}},
             nodes={"left": ["a", "one.a", "two.a"], "right": ["b", "one.b", "two.b"]})
    d.add("Pair", "pair").connect("wall.a", "pair.a").connect("cart.a", "pair.b")
    assert hb.assemble(d).parameter_values["pair.two.k"] == 9e3


def _mass_of_metres(d: hb.Diagram) -> object:
    return d.add("Mass", "load", m="3 m").model()  # <- unit


def _unknown_port(d: hb.Diagram) -> object:
    d.add("Mass", "load", m="3 kg")
    return hb.assemble(d.connect("load.b", node="load"))


def _unknown_kind(d: hb.Diagram) -> object:
    return hb.assemble(d.add("Mas", "load", m="3 kg"))


def _unknown_parameter(d: hb.Diagram) -> object:
    return hb.assemble(d.add("Mass", "load",
                             m="3 kg",
                             M="2 kg"))


def _same_name(d: hb.Diagram) -> object:
    return d.add("Mass", "load").add("Spring", "load")


def _wrong_law(d: hb.Diagram) -> object:
    return d.define("Bad", summary="wrong", ports={"a": "translational"}, parameters={"k": {"unit": "N"}},
                    equations=["a.f = k*a.v"])


def _unknown_output(d: hb.Diagram) -> object:
    d.add("Mass", "load", m="3 kg").connect("load.a", node="load").show("speed", "load.w", unit="m/s")
    return hb.assemble(d)


def _dictionary(d: hb.Diagram) -> object:
    content = {"model": "rig", "components": {
        "load": {"is": "Mass", "m": "7 mm"}}}
    return hb.assemble(hb.Diagram.from_dict(content))


def _equations(d: hb.Diagram) -> object:
    return d.define("Bad", summary="wrong", ports={"a": "translational"}, equations="""
        a.f = 2*a.v +
    """)


@pytest.mark.parametrize(("build", "code", "line", "caret"), [
    (_mass_of_metres, "unit-wrong", 1, "3 m"), (_unknown_port, "port-unknown", 2, "load.b"),
    (_unknown_kind, "component-unknown", 1, "Mas"), (_unknown_parameter, "parameter-unknown", 3, "2 kg"),
    (_same_name, "name-twice", 1, "load"), (_wrong_law, "units-differ", 2, "k*a.v"),
    (_unknown_output, "name-unknown", 1, "load.w"), (_dictionary, "unit-wrong", 2, "7 mm"),
    (_equations, "formula-incomplete", 2, ""),
])
def test_a_message_shows_the_line_of_the_program(build: Callable[[hb.Diagram], object], code: str, line: int, caret: str
                                                 ) -> None:
    with pytest.raises(hb.HeavebondError, match=code) as caught:
        hb.assemble(build(hb.Diagram("rig")))
    problem = next(p for p in caught.value.problems if p.code == code)
    assert problem.place is not None and problem.place.file.endswith("test_python_diagrams.py")
    assert problem.place.line == build.__code__.co_firstlineno + line
    shown = problem.place.text[problem.place.column - 1:]
    assert shown.startswith(caret) and problem.hint


def test_interactive_input_shows_what_was_given() -> None:
    scope: dict[str, object] = {"hb": hb}
    with pytest.raises(hb.ModelError, match="there is no component 'Mas'") as caught:
        exec("d = hb.Diagram('rig')\nd.add('Mas', 'load')\nhb.assemble(d)", scope)
    place = caught.value.problems[0].place
    assert place is not None and (place.file, place.line) == ("<string>", 2) and "Mas" in place.text


@pytest.mark.parametrize(("call", "code", "hint"), [
    (lambda d: d.update(simulat={"until": "1 s"}), "key-unknown", "simulate"),
    (lambda d: d.update(nodes={}), "key-unknown", "connect("),
    (lambda d: d.define("X", summry="x"), "key-unknown", "summary"),
    (lambda d: d.remove("wal"), "remove-unknown", "wall"),
    (lambda d: d.add("Mass", "m", m=object()), "python-value", "250 kg"),
    (lambda d: d.show("place", "load.x", unit="mm"), "name-twice", "another name"),
    (lambda d: d.define("S", **SNUBBER).define("S", **SNUBBER), "name-twice", "another name"),
    (lambda d: hb.Diagram.from_dict({"name": "x"}), "not-a-model", "model"),
    (lambda d: hb.modes(hb.assemble(d)), "not-a-model", ".model"),
    (lambda d: d.save("cart.txt"), "file-suffix", "cart.yaml"),
    (lambda d: hb.Diagram.read("nowhere"), "file-missing", "bundled name"),
])
def test_a_wrong_call_names_what_to_type(call: Callable[[hb.Diagram], object], code: str, hint: str) -> None:
    with pytest.raises(hb.HeavebondError, match=code) as caught:
        call(cart())
    assert hint in caught.value.problems[0].hint


@pytest.mark.parametrize(("call", "code", "words"), [
    (lambda d: d.add("pulley", "Mass"), "component-unknown", 'add("Mass", "pulley")'),
    (lambda d: d.connect(["spring.b", "cart.a"]), "python-value", "one after the other"),
    (lambda d: d.connect("spring.b", node=["x"]), "python-value", "a node"),
    (lambda d: hb.simulate(d, [0, 2]), "not-a-quantity", "until: a list"),
    (lambda d: hb.simulate(d, parameters={"cart.m": np.array([1.0, 2.0])}), "not-a-quantity", "cart.m: a ndarray"),
    (lambda d: hb.simulate(d, parameters={"cart.m": 3 + 2j}), "not-a-quantity", "cart.m: a complex"),
    (lambda d: d.model().with_parameters({"cart.m": None}), "not-a-quantity", "cart.m: a NoneType"),
    (lambda d: hb.simulate((d, "2 s")), "not-a-model", "a tuple is not a diagram"),
    (lambda d: hb.simulate(d.as_dict()), "not-a-model", "from_dict"),
    (lambda d: hb.assemble(d.show("speed", "load.v")), "key-missing", "unit"),
    (lambda d: d.update(simulate="5 s"), "not-a-mapping", 'update(simulate={"until"'),
    (lambda d: hb.modes(d, at="stedy"), "not-a-quantity", "steady"),
    (lambda d: hb.sweep(d, {"spring.c": 3e3}, "rms(place)"), "over-form", "spring.c: a float"),
    (lambda d: hb.sweep(d, "spring.c", "rms(place)"), "over-form", "over={"),
    (lambda d: hb.sweep(d, {"spring.c": ["3 kN/m"]}, "rms(plaice)", processes=1), "name-unknown", "'place'"),
    (lambda d: hb.simulate(d)["plaice"], "name-unknown", "'place'"),
    (lambda d: hb.simulate(d)["load.x + load.v"], "units-differ", "they differ by a factor in s"),
])
def test_a_mistake_of_a_new_user_names_what_to_type(call: Callable[[hb.Diagram], object], code: str, words: str) -> None:
    with pytest.raises(hb.HeavebondError, match=code) as caught:
        call(cart())
    assert words in str(caught.value), caught.value


def test_quantities_of_pint_are_values_of_parameters() -> None:
    pint = pytest.importorskip("pint")
    unit = pint.Unit
    run = hb.simulate(cart(), 1 * unit("s"), parameters={"cart.m": 20 * unit("kg"), "spring.c": 2 * unit("kN/m")})
    same = hb.simulate(cart(), "1 s", parameters={"cart.m": "20 kg", "spring.c": "2 kN/m"})
    assert (run["load.x"] == same["load.x"]).all()


def test_a_wrong_definition_is_not_kept() -> None:
    d = cart()
    with pytest.raises(hb.ModelError):
        d.define("Snubber", **{**SNUBBER, "equations": ["w = a.v"]})
    assert hb.simulate(d.define("Snubber", **SNUBBER)).time[-1] == 1


def test_a_chain_of_many_parts_is_built_quickly() -> None:
    began = time.perf_counter()
    d = hb.Diagram("chain").add("Fixed", "wall")
    for k in range(250):
        d.add("Mass", f"m{k}", m=1.0 + k).add("Spring", f"s{k}", c=1e3)
        d.connect(f"m{k - 1}.a" if k else "wall.a", f"s{k}.a").connect(f"s{k}.b", f"m{k}.a")
    assert len(d.model().body.instances) == 501
    assert time.perf_counter() - began < 10  # half a second on a quiet processor; 17 s if each call reads the library


def test_a_diagram_extends_another() -> None:
    d = hb.Diagram("calm", extends="quarter_car").update(set={"body.m": 400.0})
    with pytest.raises(hb.ModelError, match="unit-missing"):
        hb.assemble(d)
    d.update(set={"body.m": "400 kg"})
    assert hb.assemble(d).parameter_values["body.m"] == 400
    changed = hb.Diagram.read("quarter_car").update(set={"body.m": "400 kg"})
    assert hb.assemble(changed).parameter_values["body.m"] == 400 and "Recursion" not in str(sys.exc_info())
