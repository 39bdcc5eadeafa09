"""Tokens of SIDOPS, the language of 20-sim models, with their lines and comments."""

from __future__ import annotations

import re
from dataclasses import dataclass

from heavebond.core.errors import ModelError, Place, Problem

TOKENS = re.compile(r"""
    (?P<space>[ \t\r\f\v\ufeff]+) | (?P<newline>\n)
  | (?P<comment>//[^\n]*?(?=implementation_end;|\n|\Z)|/\*.*?\*/)
  | (?P<string>'[^']*'|"[^"]*")
  | (?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+|(?P<prefix>[afpnumkMGTP])(?!\w))?)
  | (?P<unit>\{[^{}\n]*\})
  | (?P<name>[^\W0-9]\w*(?:[.\\][^\W0-9]\w*)*)
  | (?P<sign>\|(?:=>|<=|->|<-)|(?:=>|<=|->|<-)\||<=|>=|<>|==|!=|->|<-|=>|\.\*|\./|\.\^|.)
""", re.VERBOSE | re.DOTALL)
MOST_TOKENS = 2_000_000
PREFIXES = {"a": -18, "f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "k": 3, "M": 6, "G": 9, "T": 12, "P": 15}
TEMPLATE = re.compile(r"equation submodel$|enter your? equations here|start typing here|20-sim linear system editor",
                      re.IGNORECASE)  # what 20-sim itself writes
ENDS = {"end", "else", "implementation_end"}  # a comment before these says nothing of what follows
OPENINGS = {"constants", "parameters", "variables", "externals", "initialequations", "equations", "code", "dynamic", ";"}


@dataclass(frozen=True)
class Token:
    """One word of the text; `kind` is string, number, unit, name, sign or end."""

    kind: str
    text: str
    line: int

    @property
    def word(self) -> str:
        """The text of a name in lower case, as keywords are compared; empty for other tokens."""
        return self.text.lower() if self.kind == "name" else ""


@dataclass(frozen=True)
class Lexed:
    """All tokens, and the comments (`//` or `/* */`) by the line of what they say: lines of text of their own before it,
    and last the comment that stands on the same line, or an empty text."""

    tokens: tuple[Token, ...]
    comments: dict[int, str]


def tokenise(text: str, file: str, first_line: int) -> Lexed:
    """The tokens of a text whose first line has the number `first_line` in the file; raises ModelError."""
    tokens: list[Token] = []
    comments: dict[int, str] = {}
    alone: list[str] = []  # comments on lines of their own
    beside: dict[int, str] = {}
    position, line = 0, first_line
    while position < len(text):
        found = TOKENS.match(text, position)
        assert found is not None  # any character is a sign at least
        kind, word = found.lastgroup or "", found.group()
        if found["prefix"]:  # 0.5m is 0.5e-3
            word = f"{word[:-1]}e{PREFIXES[found['prefix']]}"
        if kind == "comment":
            if tokens and tokens[-1].line == line:
                beside[line] = " ".join(word.strip("/*").split())
            else:
                said = [" ".join(text.strip("/* \t").split()) for text in word.splitlines()]
                alone += [text for text in said if text and not TEMPLATE.match(text)]
        elif kind not in ("space", "newline"):
            if word.lower() in ENDS:
                alone = []
            elif alone and word.lower() not in OPENINGS:
                comments[line], alone = "\n".join([*alone, ""]), []
            tokens.append(Token(kind, word, line))
            if len(tokens) > MOST_TOKENS:
                raise ModelError([Problem("emx-size", "the model has more than two million words", Place(file, line))])
        line += word.count("\n")
        position = found.end()
    for line_of, text in beside.items():
        comments[line_of] = comments.get(line_of, "") + text
    tokens.append(Token("end", "", line))
    return Lexed(tuple(tokens), comments)
