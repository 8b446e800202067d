"""The curve language: right for valid expressions, and nothing else gets through."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb.errors import DeformError
from deformnb.rbf.extrusion import (
    DEEPEST_FORMULA,
    FORMULA_CONSTANTS,
    FUNCTIONS,
    LARGEST_POWER,
    LONGEST_FORMULA,
    evaluate,
)

Z = np.linspace(0, 1, 11)
WITH_PYTHON = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "min": min,
    "max": max,
    "pi": math.pi,
    "e": math.e,
}

LEAVES = st.one_of(
    st.sampled_from(["z", "pi", "e"]),
    st.integers(0, 20).map(str),
    st.floats(0, 9, allow_subnormal=False).map(lambda v: format(v, ".3g")),
)


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*/^"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda t: f"{t[0]}{t[1]}{t[2]}"),
        st.tuples(st.sampled_from("+-"), inner).map("".join),
        st.tuples(st.sampled_from([f for f, (_, n) in FUNCTIONS.items() if n == 1]), inner).map(
            lambda t: f"{t[0]}({t[1]})"
        ),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(lambda t: f"{t[0]}({t[1]}, {t[2]})"),
    )


def evaluate_in_python(text: str, z: float) -> Any:
    return eval(text.replace("^", "**"), {"__builtins__": {}}, {**WITH_PYTHON, "z": z})


@given(st.recursive(LEAVES, grown, max_leaves=8))
def test_agrees_with_python(text: str) -> None:
    try:
        ours = evaluate(text, Z)
    except DeformError as error:
        if any(part in str(error) for part in ("characters", "too deeply", "power above")):
            return
        ours = None
    theirs = []
    for z in Z:
        try:
            value = evaluate_in_python(text, float(z))
            theirs.append(float(value) if not isinstance(value, complex) else math.nan)
        except (ZeroDivisionError, ValueError, OverflowError):
            theirs.append(math.nan)
    wanted = np.array(theirs)
    if ours is None:  # not finite somewhere, and then Python must have stumbled too
        assert not np.isfinite(wanted).all()
        return
    # Python stops at 1/0 and at overflow where arrays continue through infinity: 1/(1/0) is 0.
    known = np.isfinite(wanted)
    oracle.assert_close(ours[known], wanted[known], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("z", Z),
        ("1", np.ones(11)),
        (" z ", Z),
        ("-z^2", -(Z**2)),
        ("2^3^z", 2.0 ** (3.0**Z)),
        ("z**2", Z**2),
        ("min(1, 3*z)", np.minimum(1, 3 * Z)),
        ("sin(pi*z)", np.sin(np.pi * Z)),
        ("1e-3+.5", np.full(11, 0.501)),
        ("4*z*(1-z)", 4 * Z * (1 - Z)),
        ("max(min(z, 1-z), 0)", np.maximum(np.minimum(Z, 1 - Z), 0)),
        ("+-+z", -Z),
        ("e^z", np.exp(Z)),
        ("((((z))))", Z),
        ("+".join(["z"] * 20), 20 * Z),
    ],
)
def test_known_values(text: str, wanted: np.ndarray) -> None:
    oracle.assert_close(evaluate(text, Z), wanted, rtol=1e-14, atol=1e-15)


def test_the_result_has_the_shape_of_z_and_is_its_own() -> None:
    for shape in ((), (3,), (2, 3), (0,)):
        z = np.full(shape, 0.5)
        for text in ("z", "2"):
            result = evaluate(text, z)
            assert result.shape == shape
            assert result.dtype == np.float64
            result[...] = 7
            assert (z == 0.5).all()


FORBIDDEN = [
    "__import__('os')",
    "z.real",
    "z.__class__",
    "().__class__",
    "(1).__class__.__bases__",
    "lambda: 1",
    "(lambda x: x)(z)",
    "[z]",
    "[z for z in z]",
    "{z}",
    "{1: z}",
    "(z, z)",
    "z if z else 1",
    "z and 1",
    "not z",
    "~z",
    "z < 1",
    "z == z",
    "z @ z",
    "z % 2",
    "z // 2",
    "z << 1",
    "z | 1",
    "z & 1",
    "z[0]",
    "z[:]",
    "f'{z}'",
    "'a'",
    "b'a'",
    "1j",
    "True",
    "None",
    "...",
    "x",
    "y := z",
    "(y := z)",
    "open('x')",
    "eval('1')",
    "exec('1')",
    "sin",
    "sin + 1",
    "sin(sin)",
    "sin()",
    "sin(z, z)",
    "sin(x=z)",
    "sin(*z)",
    "sin(**z)",
    "min(z)",
    "min(z, z, z)",
    "pi(z)",
    "z(z)",
    "sin(z)(z)",
    "abs.real",
    "print(z)",
    "import os",
    "z; z",
    "z = 1",
    "z\nz",
    "del z",
    "await z",
    "yield z",
    "@z",
    "$z",
    "z!",
    "1(2)",
    "nan",
    "inf",
    "np.sin(z)",
    "sinh(z)",
    "π*z",
    "(",
    ")",
    "z +",
    "z z",
    "\\",
    "\0",
    "z\0",
    "\ud800",
    "`z`",
    "*z",
    "z,",
]


@pytest.mark.parametrize("text", FORBIDDEN)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(DeformError, match="the curve") as error:
        evaluate(text, Z)
    assert error.value.__suppress_context__ or error.value.__context__ is None  # one message, no second traceback


@pytest.mark.parametrize(
    "text",
    [
        "1/0",
        "0/0",
        "1/z",
        "log(z)",
        "log(-1)",
        "sqrt(z - 1)",
        "(z-1)^0.5",
        "(-pi)^(pi/e)",
        "pi/(e-e)",
        "0^(-z-1)",
        "1e999",
        "-1e999",
        "exp(1e3)",
        "(pi^(pi^pi))^(pi^pi)",
        "(((2^64)^64)^64)^64",
        "1e308*10",
        "z*1e999",
        "sin(1e999)",
        "tan(1/0)",
    ],
)
def test_values_that_are_not_finite_are_refused_with_their_place(text: str) -> None:
    with pytest.raises(DeformError, match=r"is not finite at z = [01]"):
        evaluate(text, Z)


@pytest.mark.parametrize(
    "text",
    [
        "9^99999999",
        "2^65",
        "z^1000",
        "2^2^2^2^2^2",
        "9**9**9**9",
        "2^(z*100)",
        "2^-65",
        f"z^{LARGEST_POWER + 1}",
    ],
)
def test_huge_powers_are_refused(text: str) -> None:
    with pytest.raises(DeformError, match="power above 64"):
        evaluate(text, Z)


def test_a_text_of_the_greatest_length_is_read() -> None:
    assert evaluate("z" + " " * (LONGEST_FORMULA - 2) + "\n", np.array([0.25])).tolist() == [0.25]


@pytest.mark.parametrize(
    "text",
    [
        "(" * 99 + "z" + ")" * 99,
        "-" * 150 + "z",
        "sin(" * 45 + "z" + ")" * 45,
        "z^" * 90 + "z",
        "+".join(["z"] * 90),
        "z" * (LONGEST_FORMULA + 1),
        " " * LONGEST_FORMULA * 100 + "z" * 500,
        "[" * 199,
        "9" * 5000,
        "(" * 1_000_000,
        "1" + "0" * 196 + "^64",
    ],
)
def test_long_and_deep_texts_are_refused_at_once(text: str) -> None:
    start = time.thread_time()
    try:
        result = evaluate(text, np.linspace(0, 1, 1025))
    except DeformError as error:
        assert len(str(error)) < LONGEST_FORMULA + 400  # noqa: PT017 (parentheses alone are no depth of a formula)
    else:
        assert np.isfinite(result).all()
        assert text.count("(") == 99
    assert time.thread_time() - start < 1  # measured: 2 ms


def test_depth_is_bounded_where_it_says() -> None:
    assert evaluate("-" * DEEPEST_FORMULA + "z", 1.0) == 1.0
    with pytest.raises(DeformError, match="nested too deeply"):
        evaluate("-" * (DEEPEST_FORMULA + 1) + "z", 1.0)


@pytest.mark.parametrize("text", ["", "   ", "\n", None, 3, ["z"], b"z"])
def test_no_text_is_refused(text: Any) -> None:
    with pytest.raises(DeformError, match="the curve is empty"):
        evaluate(text, Z)


@given(st.one_of(st.text(max_size=40), st.text("z+-*/^()., 0123456789episncoqrtabmlgx_[]{}'\"\\\n\t", max_size=60)))
def test_no_text_ever_raises_anything_else(text: str) -> None:
    try:
        result = evaluate(text, Z)
    except DeformError:
        return
    assert np.isfinite(result).all()
    assert result.shape == Z.shape


def test_names_do_not_collide() -> None:
    assert not set(FORMULA_CONSTANTS) & set(FUNCTIONS)
    assert "z" not in {*FORMULA_CONSTANTS, *FUNCTIONS}


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("2z", "2*z"),
        ("3 sin(pi*z)", "3*sin(...)"),
        ("2(z+1)", "2*(...)"),
        ("z(1-z)", "z*(...)"),
        ("2 pi z", "2*pi"),
        ("(1+z)(2-z)", "(...)*(...)"),
        ("4*z(1-z)", "z*(...)"),
        ("1.5z", "1.5*z"),
        ("1e5z", "1e5*z"),
        ("sin(z)cos(z)", "(...)*cos(...)"),
    ],
)
def test_products_as_on_paper_are_understood_and_refused_with_the_star(text: str, advice: str) -> None:
    with pytest.raises(DeformError, match=r"every product with \*") as caught:
        evaluate(text, Z)
    assert str(caught.value).endswith(f"such as {advice}.")


@pytest.mark.parametrize("text", ["?", "2*z +", "sin z", "zz", "sinh(z)"])
def test_other_mistakes_are_not_taken_for_products(text: str) -> None:
    with pytest.raises(DeformError) as caught:
        evaluate(text, Z)
    assert "product" not in str(caught.value)
