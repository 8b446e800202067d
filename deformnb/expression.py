"""A small, safe language for the curve f(z) of an extrusion: ``z``, ``sin(pi*z)``, ``4*z*(1-z)``, ``min(1, 3*z)``.

The text is parsed, checked node by node against a white list and evaluated on an array; nothing of it ever reaches
``eval``, no name but those below exists, and its length, depth and powers are bounded.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.errors import DeformError

LONGEST = 200
DEEPEST = 20
LARGEST_POWER = 64.0

# NumPy numbers: Python's raise ZeroDivisionError and OverflowError, and (-pi)^0.5 is complex.
CONSTANTS = {"pi": np.float64(np.pi), "e": np.float64(np.e)}
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "sin": (np.sin, 1), "cos": (np.cos, 1), "tan": (np.tan, 1), "exp": (np.exp, 1), "log": (np.log, 1),
    "sqrt": (np.sqrt, 1), "abs": (np.abs, 1), "min": (np.minimum, 2), "max": (np.maximum, 2),
}
"""Functions by name, with their number of arguments."""

# A product as on paper: 2z, 3 sin(z), (1+z) z. With brackets alone it parses as a call: z(1-z).
_PRODUCT = re.compile(rf"(\d[\d.]*(?:e[+-]?\d+)?|\bz|\bpi|\))\s*(z\b|pi\b|(?:{'|'.join(FUNCTIONS)})\(|\()")

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos,
}


def evaluate(text: str, z: ArrayLike) -> NDArray[np.float64]:
    """The value of an expression in z.

    Parameters
    ----------
    text : numbers, ``z``, ``pi``, ``e``, + - * / ^ (or **), parentheses and :data:`FUNCTIONS`; at most 200 characters.
    z : array of any shape.

    Returns
    -------
    float64 array of z's shape.

    Raises
    ------
    DeformError
        If the text is anything else, or gives a value that is not finite, saying at which z.

    Examples
    --------
    >>> evaluate("4*z*(1-z)", [0.0, 0.5, 1.0]).tolist()
    [0.0, 1.0, 0.0]
    """
    values = np.asarray(z, dtype=np.float64)
    tree = _parse(text)
    with np.errstate(all="ignore"):
        result = np.broadcast_to(np.asarray(_value(tree, values, 0, text), dtype=np.float64), values.shape)
    bad = ~np.isfinite(result)
    if bad.any():
        raise DeformError(f"the curve {text!r} is not finite at z = {values[bad].flat[0]:.6g}; change it there.")
    return np.array(result)


def _parse(text: str) -> ast.expr:
    if not isinstance(text, str) or not text.strip():
        raise DeformError("the curve is empty; write for example z or sin(pi*z).")
    if len(text) > LONGEST:
        raise DeformError(f"the curve has {len(text)} characters; at most {LONGEST} are allowed.")
    try:
        return ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise DeformError(f"the curve {text!r} is not a formula; {_advice(text)}.") from None


def _advice(text: str) -> str:
    """What to write instead."""
    product = _PRODUCT.search(text)
    if product is None:
        return "write for example z or sin(pi*z)"
    left, right = product[1].replace(")", "(...)"), product[2].replace("(", "(...)")
    return f"write every product with *, such as {left}*{right}"


def _value(node: ast.expr, z: NDArray[np.float64], depth: int, text: str) -> Any:
    if depth > DEEPEST:
        raise DeformError(f"the curve {text!r} is nested too deeply.")
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as number):
            return np.float64(number)
        case ast.Name(id="z"):
            return z
        case ast.Name(id=name) if name in CONSTANTS:
            return CONSTANTS[name]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(operand, z, depth + 1, text))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            a, b = _value(left, z, depth + 1, text), _value(right, z, depth + 1, text)
            if isinstance(op, ast.Pow) and np.abs(b).max(initial=0.0) > LARGEST_POWER:
                raise DeformError(f"the curve {text!r} has a power above {LARGEST_POWER:g}.")
            return _OPERATORS[type(op)](a, b)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            function, arity = FUNCTIONS[name]
            if len(args) != arity:
                raise DeformError(f"{name} in the curve {text!r} takes {arity} argument(s), not {len(args)}.")
            return function(*(_value(a, z, depth + 1, text) for a in args))
        case ast.Call(func=ast.Name(id="z" | "pi" | "e") | ast.BinOp() | ast.Constant() | ast.Call()):
            raise DeformError(f"the curve {text!r} is not a formula; {_advice(text)}.")
        case _:
            pass
    raise DeformError(
        f"the curve {text!r} may only use numbers, z, pi, e, + - * / ^ and {', '.join(FUNCTIONS)}; "
        f"{ast.unparse(node)!r} is something else."
    )
