"""The structure of a SIDOPS text: submodels, ports, implementations and connections."""

from __future__ import annotations

import html
import re

from heavebond.core.errors import ModelError, Place, Problem
from heavebond.import_20sim.expressions_parser import Reader, Unreadable
from heavebond.import_20sim.sidops_lexer import tokenise
from heavebond.import_20sim.sidops_tree import Connection, Equations, Port, Submodel

DIRECTIONS = {"in", "out", "none"}
RELATIONS = re.compile(r"<GlobalRelations>(.*?)</GlobalRelations>", re.DOTALL)
PORT_WORDS = {"knot", "duplicatable", "psi", "boolean", "integer", "real", "interesting", "hidden", "global", "string",
              "delta"}


def parse_sidops(text: str, file: str, first_line: int = 1) -> Submodel:
    """The main model of a SIDOPS text, or the submodel that a library file contains as the only part of a main model;
    raises ModelError if its structure cannot be read."""
    reader = Reader(tokenise(text, file, first_line), file)
    try:
        name, following = reader.current, reader.tokens[min(1, len(reader.tokens) - 1)]
        if name.kind in ("name", "string") and name.word != "model" and following.kind == "number":
            reader.take()
            return Submodel("model", name.line, submodels=[_submodel(reader, name.text.strip("'"))])
        reader.need("model")
        return _submodel(reader, "model")
    except Unreadable as problem:
        raise ModelError([Problem("emx-structure", f"the SIDOPS text cannot be read: {problem.reason}",
                                  Place(file, problem.line))]) from None


def _submodel(reader: Reader, name: str) -> Submodel:
    """Parse the text after the name of a submodel."""
    reader.deeper()
    submodel = Submodel(name, reader.current.line)
    place = []
    while reader.current.kind == "number" or reader.current.text == "-":
        sign = -1.0 if reader.skip("-") else 1.0
        if reader.current.kind == "number":
            place.append(sign * float(reader.take().text))
    submodel.x, submodel.y = (*place, 0.0, 0.0)[:2]
    if reader.skip("specifications"):
        # one of several implementations: the active one is kept
        reader.need("active")
        active = reader.take().text
        while reader.skip("specification"):
            chosen = reader.take().text == active
            inner = Submodel(submodel.name, reader.current.line, submodel.x, submodel.y)
            _placement(reader)
            _body(reader, inner)
            _placement(reader)
            reader.need("specification_end")
            reader.skip(";")
            if chosen:
                submodel.__dict__.update(inner.__dict__)
        reader.need("end")
        reader.skip(";")
    else:
        _body(reader, submodel)
    reader.depth -= 1
    return submodel


def _placement(reader: Reader) -> None:
    """Skip optional parts of a specification after its implementation: texts, and the place and size of its icon."""
    while reader.current.kind in ("string", "number") or reader.current.text in ("-", ";"):
        reader.take()


def _body(reader: Reader, submodel: Submodel) -> None:
    _description(reader, submodel)
    submodel.knot = reader.current.word == "knot"
    if not reader.skip("type", "knot"):
        raise Unreadable(reader.current.line, f"'type' is missing before '{reader.current.text[:30]}'")
    submodel.type = reader.take().text.strip("'")
    while reader.current.kind != "end" and not reader.skip("end"):
        if reader.skip("ports"):
            while reader.current.kind == "name" and reader.current.word not in ("end", "parameters", "restrictions",
                                                                                "variables",
                                                                                "description"):
                submodel.ports.append(_port(reader))
        elif reader.skip("parameters"):
            submodel.parameters += reader.declarations(submodel.problems)
        elif reader.skip("variables", "constants"):
            submodel.variables += reader.declarations(submodel.problems)
        elif reader.skip("restrictions"):
            while reader.current.word in ("causality", "fixed", "constraint"):
                reader.to_semicolon()
        else:
            reader.take()
    reader.skip(";")
    while reader.current.word in ("icon", "description", "help"):
        if reader.current.word == "icon":
            # skip an icon, up to the `end` at the beginning of a statement; groups nest
            depth, starts = 1, True
            reader.take()
            while depth and reader.current.kind != "end":
                token = reader.take()
                if starts and token.word == "end":
                    depth -= 1
                elif starts and token.word == "group":
                    depth += 1
                starts = token.text == ";" or token.word in ("figures", "terminals", "group") \
                    or (starts and token.kind == "name")
            reader.skip(";")
        else:
            _description(reader, submodel)
    if not reader.skip("implementation"):
        return
    kind = reader.take().word
    if kind == "bg":
        _graph(reader, submodel)
    elif kind == "eq":
        submodel.equations = _equations(reader)
    else:
        submodel.problems.append((reader.current.line, f"an implementation `{kind}` is not translated"))
        while reader.current.kind != "end" and reader.current.word != "implementation_end":
            reader.take()
    reader.need("implementation_end")
    reader.skip(";")
    # some elements of the library have their last equations after `implementation_end`
    while submodel.equations and reader.current.kind == "name" and reader.tokens[reader.at + 1].text in ("=", "["):
        submodel.equations.equations += reader.statements("specification", "end")


def _description(reader: Reader, submodel: Submodel) -> None:
    """Skip descriptions, except for the global relations in them."""
    while reader.skip("description", "help"):
        while reader.current.kind == "string":
            token = reader.take()
            for relations in RELATIONS.finditer(token.text):
                line = token.line + token.text.count("\n", 0, relations.start(1))
                text = html.unescape(relations.group(1))
                inner = Reader(tokenise(text, reader.file, line), reader.file)
                submodel.comments.update(inner.comments)
                submodel.relations = _equations(inner)
        reader.skip(";")


def _port(reader: Reader) -> Port:
    line, domain = reader.current.line, reader.take().word
    words: list[str] = []
    name = ""
    while reader.current.kind == "name":
        token = reader.take()
        if token.word in PORT_WORDS | DIRECTIONS and reader.current.kind == "name":
            words.append(token.word)
        else:
            name = token.text
            break
    size, unit = [], ""
    while reader.current.text not in (";", ""):
        if reader.skip("["):
            while reader.current.text not in ("]", ";", ""):
                size.append(reader.expression())
                reader.skip(",")
            reader.skip("]")
        elif reader.current.kind == "unit":
            unit = reader.take().text[1:-1].strip()
        else:
            reader.take()
    reader.skip(";")
    doc = ""
    while reader.current.kind == "string":
        doc = reader.take().text[1:-1]
        reader.skip(";")
    if not name:
        raise Unreadable(line, "a port has no name")
    direction = next((w for w in words if w in DIRECTIONS), "none")
    return Port(name, domain, direction, line, "duplicatable" in words, tuple(size), unit, "delta" in words, doc)


def _equations(reader: Reader) -> Equations:
    equations = Equations()
    declared = {"constants": equations.constants, "parameters": equations.parameters, "variables": equations.variables,
                "externals": equations.externals}
    written = {"initialequations": equations.initial, "equations": equations.equations, "code": equations.code,
               "dynamic": equations.equations, "finalequations": []}  # the last ones act after the run
    while reader.current.kind != "end" and reader.current.word != "implementation_end":
        token = reader.take()
        if token.word in declared:
            declared[token.word] += reader.declarations(equations.problems)
        elif token.word in written:
            written[token.word] += reader.statements()
        elif token.text not in ("", ";") and token.kind != "string":
            equations.problems.append((token.line, f"'{token.text[:30]}' is not translated"))
            while reader.current.kind != "end" and reader.current.word not in (*declared, *written, "implementation_end"):
                reader.take()
    return equations


def _graph(reader: Reader, submodel: Submodel) -> None:
    while reader.current.kind != "end" and reader.current.word != "implementation_end":
        if reader.skip("submodels"):
            while reader.current.kind in ("name", "string") and reader.current.word != "end":
                token = reader.take()
                if token.word == "plug" and reader.current.kind == "name":
                    reader.to_semicolon()
                else:
                    submodel.submodels.append(_submodel(reader, token.text.strip("'")))
            reader.need("end")
            reader.skip(";")
        elif reader.skip("connections"):
            while reader.current.kind in ("name", "string") and reader.current.word != "end":
                # `a -> b` for a signal, `a => b` for a bond; a bar marks the causal stroke of a bond
                line, start = reader.current.line, _end(reader)
                sign = reader.take().text.strip("|")
                stop = _end(reader)
                reader.to_semicolon()
                if sign in ("->", "=>"):
                    connection = Connection(start, stop, sign == "=>", line)
                elif sign in ("<-", "<="):
                    connection = Connection(stop, start, sign == "<=", line)
                else:
                    raise Unreadable(line, f"'{sign}' is not a connection")
                submodel.connections.append(connection)
            reader.need("end")
            reader.skip(";")
        elif reader.current.word in ("figures", "variables", "parameters"):
            while reader.current.kind != "end" and reader.current.word not in ("submodels", "connections",
                                                                               "implementation_end"):
                reader.take()
        else:
            reader.take()


def _end(reader: Reader) -> str:
    r"""One end of a connection: names, in quotes if they contain spaces, with `\` between them."""
    path = reader.take().text.strip("'")
    while reader.current.text == "\\" or (reader.current.kind in ("name", "string") and path.endswith("\\")):
        path += reader.take().text.strip("'")
    return path
