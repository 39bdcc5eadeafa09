"""The parts of a SIDOPS text as values: submodels, ports, declarations, statements, expressions."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import blake2b


@dataclass(frozen=True, eq=False, slots=True)
class Expr:
    """A node of an expression. `op` is number, name, text, call, index, matrix, range, if, or the sign of an operation.

    Nodes with the same content are equal, regardless of their places. Branches share their parts, so a node stores a
    digest of its content (BLAKE2, 128 bits), by which nodes are compared: a traversal would visit a part as often as it
    is used, which doubles with each choice.
    """

    op: str
    args: tuple[Expr, ...] = ()
    name: str = ""
    value: float = 0.0
    line: int = 0
    columns: int = 0  # number of elements in a row of a matrix
    key: bytes = field(init=False, repr=False)
    size: int = field(init=False, repr=False)  # number of nodes without sharing

    def __post_init__(self) -> None:
        content = f"{self.op}\0{self.name}\0{self.value + 0.0!r}\0{self.columns}\0{len(self.args)}\0".encode("utf-8",
                                                                                                             "replace")
        object.__setattr__(self, "key", blake2b(content + b"".join(e.key for e in self.args), digest_size=16).digest())
        object.__setattr__(self, "size", 1 + sum(e.size for e in self.args))

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Expr) and self.key == other.key


@dataclass(frozen=True)
class Assign:
    """`left = right`; in `code` sections an assignment, in `equations` an equation."""

    left: Expr
    right: Expr
    line: int


@dataclass(frozen=True)
class If:
    """A conditional statement."""

    condition: Expr
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]
    line: int


@dataclass(frozen=True)
class For:
    """A loop over whole numbers."""

    name: str
    first: Expr
    last: Expr
    body: tuple[Statement, ...]
    line: int
    step: Expr | None = None


@dataclass(frozen=True)
class While:
    """`while c do ... end`; with `after`, `repeat ... until c`."""

    condition: Expr
    body: tuple[Statement, ...]
    after: bool
    line: int


@dataclass(frozen=True)
class Do:
    """A call for its effect (`stopsimulation ('...')`), or a statement that cannot be read (`error` gives the reason)."""

    call: Expr
    line: int
    error: str = ""


Statement = Assign | If | For | While | Do


@dataclass(frozen=True)
class Declared:
    """A parameter, variable, constant or external quantity."""

    name: str
    kind: str  # real, integer, boolean, string
    line: int
    words: tuple[str, ...] = ()  # global, hidden, import, export ...
    size: tuple[Expr, ...] = ()
    value: Expr | None = None
    unit: str = ""
    doc: str = ""
    before: str = ""  # comments on separate lines before it

    @property
    def is_global(self) -> bool:
        return "global" in self.words


@dataclass(frozen=True)
class Port:
    """A port of a submodel; `domain` is signal, power, hydraulic ...; `direction` in, out or none."""

    name: str
    domain: str
    direction: str
    line: int
    many: bool = False  # for a knot: one port for each connection
    size: tuple[Expr, ...] = ()
    unit: str = ""
    terminals: bool = False  # two terminals, `p_high` and `p_low`, of an element of a circuit
    doc: str = ""


@dataclass(frozen=True)
class Connection:
    """A bond or a signal from one end to the other; an end is a path with `\\`."""

    start: str
    stop: str
    bond: bool
    line: int


@dataclass
class Equations:
    """The sections of an implementation by equations."""

    constants: list[Declared] = field(default_factory=list)
    parameters: list[Declared] = field(default_factory=list)
    variables: list[Declared] = field(default_factory=list)
    externals: list[Declared] = field(default_factory=list)
    initial: list[Statement] = field(default_factory=list)
    equations: list[Statement] = field(default_factory=list)
    code: list[Statement] = field(default_factory=list)
    problems: list[tuple[int, str]] = field(default_factory=list)


@dataclass
class Submodel:
    """A submodel with its place in the drawing; made of equations or of submodels."""

    name: str
    line: int
    x: float = 0.0
    y: float = 0.0
    type: str = ""
    knot: bool = False
    ports: list[Port] = field(default_factory=list)
    parameters: list[Declared] = field(default_factory=list)
    variables: list[Declared] = field(default_factory=list)
    equations: Equations | None = None
    submodels: list[Submodel] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    relations: Equations | None = None  # global relations: quantities of all submodels within
    comments: dict[int, str] = field(default_factory=dict)  # of the relations, by line
    problems: list[tuple[int, str]] = field(default_factory=list)
