"""Functions of SIDOPS between vectors and matrices, by elements.

Homogeneous transforms are 4 x 4, twists and wrenches 6 x 1 with the rotation first, as in screw theory.
"""

from __future__ import annotations

from collections.abc import Callable

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.sidops_tree import Expr

Matrix = list[list[Expr]]
LARGEST_INVERSE = 4  # largest size for cofactors, whose number grows with the factorial


def total(elements: list[Expr]) -> Expr:
    """The sum of elements."""
    result = f.number(0)
    for e in elements:
        result = f.add(result, e)
    return result


def multiplied(elements: list[Expr]) -> Expr:
    result = f.number(1)
    for e in elements:
        result = f.multiply(result, e)
    return result


def extreme(name: str, elements: list[Expr]) -> Expr:
    """The least (`min`) or largest (`max`) of elements."""
    result = elements[0]
    for e in elements[1:]:
        result = f.call(name, result, e)
    return result


def _inner(a: Matrix, b: Matrix) -> Matrix:
    pairs = zip([e for row in a for e in row], [e for row in b for e in row], strict=True)
    return [[total([f.multiply(x, y) for x, y in pairs])]]


def _cross(a: Matrix, b: Matrix) -> Matrix:
    (x, y, z), (u, v, w) = ([e for row in m for e in row] for m in (a, b))
    return [[Expr("-", (f.multiply(p, q), f.multiply(r, s)))] for p, q, r, s in ((y, w, z, v), (z, u, x, w), (x, v, y, u))]


def _skew(a: Matrix) -> Matrix:
    x, y, z = (e for row in a for e in row)
    zero = f.number(0)
    return [[zero, f.negative(z), y], [z, zero, f.negative(x)], [f.negative(y), x, zero]]


def _minor(m: Matrix, i: int, k: int) -> Matrix:
    return [[e for j, e in enumerate(row) if j != k] for h, row in enumerate(m) if h != i]


def _determinant(m: Matrix) -> Expr:
    """Expansion along the first row."""
    if not m or any(len(row) != len(m) for row in m) or len(m) > LARGEST_INVERSE:
        raise ValueError
    if len(m) == 1:
        return m[0][0]
    determinant = f.number(0)
    for k, e in enumerate(m[0]):
        term = f.multiply(e, _determinant(_minor(m, 0, k)))
        determinant = f.add(determinant, term if k % 2 == 0 else f.negative(term))
    return determinant


def _inverse(m: Matrix) -> Matrix:
    size = _determinant(m)
    # the transposed matrix of the cofactors: inverse times determinant
    if len(m) == 1:
        cofactors = [[f.number(1)]]
    else:
        signed = [[_determinant(_minor(m, i, k)) for k in range(len(m))] for i in range(len(m))]
        cofactors = [[signed[k][i] if (i + k) % 2 == 0 else f.negative(signed[k][i]) for k in range(len(m))]
                     for i in range(len(m))]
    return [[Expr("/", (e, size)) for e in row] for row in cofactors]


def _solved(a: Matrix, b: Matrix) -> Matrix:
    """`linsolve (A, b)`: x of A x = b."""
    return product(_inverse(a), b)


def product(a: Matrix, b: Matrix) -> Matrix:
    """The product of two matrices of compatible sizes."""
    if len(a[0]) != len(b):
        raise ValueError
    return [[total([f.multiply(e, column[k]) for e, column in zip(row, b, strict=True)]) for k in range(len(b[0]))]
            for row in a]


def power(m: Matrix, exponent: int) -> Matrix:
    """Power of a square matrix with a whole exponent."""
    result: Matrix = [[f.number(float(i == k)) for k in range(len(m))] for i in range(len(m))]
    for _ in range(exponent):
        result = product(result, m)
    return result


def _transposed(m: Matrix) -> Matrix:
    return [[row[k] for row in m] for k in range(len(m[0]))]


def _half(m: Matrix, sign: int) -> Matrix:
    """The symmetric (sign 1) or antisymmetric (-1) part."""
    return [[Expr("/", (f.add(e, transposed if sign > 0 else f.negative(transposed)), f.number(2))) for e, transposed in
             zip(row, column, strict=True)] for row, column in zip(m, _transposed(m), strict=True)]


def _homogeneous(rotation: Matrix, place: Matrix) -> Matrix:
    last = [f.number(0)] * 3 + [f.number(1)]
    if (len(rotation), len(rotation[0]), len(place)) != (3, 3, 3):
        raise ValueError
    return [[*row, p[0]] for row, p in zip(rotation, place, strict=True)] + [last]


def _inverse_homogeneous(h: Matrix) -> Matrix:
    rotation = _transposed([row[:3] for row in h[:3]])
    place = product(rotation, [[row[3]] for row in h[:3]])
    return _homogeneous(rotation, [[f.negative(e) for e in row] for row in place])


def _homogeneous_product(a: Matrix, b: Matrix) -> Matrix:
    """The product of two homogeneous matrices, whose last row is 0, 0, 0, 1."""
    if (len(a), len(a[0]), len(b), len(b[0])) != (4, 4, 4, 4):
        raise ValueError
    rotation = [row[:3] for row in a[:3]]
    translated = product(rotation, [[row[3]] for row in b[:3]])
    place = [[f.add(row[0], old[3])] for row, old in zip(translated, a[:3], strict=True)]
    return _homogeneous(product(rotation, [row[:3] for row in b[:3]]), place)


def _halves(args: tuple[Matrix, ...]) -> tuple[Matrix, Matrix]:
    """Two vectors of three elements, given separately or as one of six."""
    rows = [[e] for m in args for row in m for e in row]
    if len(rows) != 6:
        raise ValueError
    return rows[:3], rows[3:]


def _of_transform(args: tuple[Matrix, ...]) -> Matrix:
    """`Adjoint`: matrix by which a homogeneous transform acts on a twist, [R 0; p~ R  R]."""
    rotation, place = ([row[:3] for row in args[0][:3]], [[row[3]] for row in args[0][:3]]) if len(args) == 1 else args
    if (len(rotation), len(rotation[0]), len(place)) != (3, 3, 3):
        raise ValueError
    zero = [f.number(0)] * 3
    return [[*row, *zero] for row in rotation] + [[*a, *b] for a, b in
                                                  zip(product(_skew(place), rotation), rotation, strict=True)]


def _of_twist(args: tuple[Matrix, ...]) -> Matrix:
    """`adjoint`: the product of a twist with another one, [w~ 0; v~ w~]."""
    w, v = _halves(args)
    zero = [f.number(0)] * 3
    return [[*row, *zero] for row in _skew(w)] + [[*a, *b] for a, b in zip(_skew(v), _skew(w), strict=True)]


def _adjoint(*args: Matrix) -> Matrix:
    """`Adjoint` of a transform (4 x 4, or 3 x 3 and 3 x 1) or `adjoint` of a twist (6 x 1, or 3 x 1 and 3 x 1)."""
    return _of_twist(args) if len(args[0][0]) == 1 else _of_transform(args)


def _tilde(*args: Matrix) -> Matrix:
    """The matrix of a twist: 4 x 4, [w~ v; 0 0]."""
    w, v = _halves(args)
    return [[*row, *place] for row, place in zip(_skew(w), v, strict=True)] + [[f.number(0)] * 4]


def _largest_row(m: Matrix) -> Matrix:
    return [[extreme("max", [total([f.call("abs", e) for e in row]) for row in m])]]


def _diagonal(m: Matrix) -> Matrix:
    flat = [e for row in m for e in row]
    return [[e if i == k else f.number(0) for k in range(len(flat))] for i, e in enumerate(flat)]


MATRICES: dict[str, Callable[..., Matrix]] = {
    "transpose": _transposed,
    "inverse": _inverse, "adjoint": _adjoint, "tilde": _tilde, "det": lambda m: [[_determinant(m)]],
    "cross": _cross, "skew": _skew, "diag": _diagonal, "inner": _inner,
    "norm": lambda m: [[f.call("sqrt", _inner(m, m)[0][0])]],
    "norm2": lambda m: [[f.call("sqrt", _inner(m, m)[0][0])]], "rows": lambda m: [[f.number(float(len(m)))]],
    "columns": lambda m: [[f.number(float(len(m[0])))]],
    "sym": lambda m: _half(m, 1), "antisym": lambda m: _half(m, -1), "norminf": _largest_row,
    "homogeneous": _homogeneous, "inverseh": _inverse_homogeneous, "multiplyh": _homogeneous_product, "linsolve": _solved,
    "trace": lambda m: [[total([row[k] for k, row in enumerate(m)])]],
}
