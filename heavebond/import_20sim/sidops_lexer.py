"""Tokens of SIDOPS, the language of 20-sim models, with their lines and comments."""

from __future__ import annotations

import re
from dataclasses import dataclass

from heavebond.core.errors import ModelError, Place, Problem

TOKENS = re.compile(r"""
    (?P<space>[ \t\r\f\v\ufeff]+) | (?P<newline>\n)
  | (?P<comment>//[^\n]*?(?=implementation_end;|\n|\Z)|/\*.*?\*/)
  | (?P<string>'[^']*'|"[^"]*")
  | (?P<number>[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?)
  | (?P<unit>\{[^{}\n]*\})
  | (?P<name>[^\W0-9]\w*(?:[.\\][^\W0-9]\w*)*)
  | (?P<sign>\|(?:=>|<=|->|<-)|(?:=>|<=|->|<-)\||<=|>=|<>|==|!=|->|<-|=>|\.\*|\./|\.\^|.)
""", re.VERBOSE | re.DOTALL)
MOST_TOKENS = 2_000_000


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
    """All tokens, and the comment that stands on a line (`//` or `/* */`), by line."""

    tokens: tuple[Token, ...]
    comments: dict[int, str]


def tokenise(text: str, file: str, first_line: int) -> Lexed:
    """The tokens of a text whose first line has the number `first_line` in the file; raises ModelError."""
    tokens: list[Token] = []
    comments: dict[int, str] = {}
    position, line = 0, first_line
    while position < len(text):
        found = TOKENS.match(text, position)
        assert found is not None  # any character is a sign at least
        kind, word = found.lastgroup or "", found.group()
        if kind == "comment":
            comments[line] = " ".join(word.strip("/*").split())
        elif kind not in ("space", "newline"):
            tokens.append(Token(kind, word, line))
            if len(tokens) > MOST_TOKENS:
                raise ModelError([Problem("emx-size", "the model has more than two million words", Place(file, line))])
        line += word.count("\n")
        position = found.end()
    tokens.append(Token("end", "", line))
    return Lexed(tuple(tokens), comments)
