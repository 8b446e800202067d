"""Closed forms of small matrices against NumPy's general ones."""

from __future__ import annotations

import numpy as np
import oracle
import pytest

from deformnb._jax import adjugate, determinant, one_plus


@pytest.mark.parametrize("dim", [2, 3])
def test_they_are_numpy_s(dim: int) -> None:
    a = np.random.default_rng(0).normal(size=(4, 5, dim, dim))
    first = np.moveaxis(a, (-2, -1), (0, 1))
    oracle.assert_close(determinant(first), np.linalg.det(a), atol=1e-13)
    wanted = np.linalg.det(a)[..., None, None] * np.linalg.inv(a)
    oracle.assert_close(np.moveaxis(adjugate(first), (0, 1), (-2, -1)), wanted, atol=1e-12)
    oracle.assert_close(
        np.einsum("mk...,kn...->mn...", first, adjugate(first)),
        np.multiply.outer(np.eye(dim), determinant(first)),
        atol=1e-13,
    )
    assert determinant(first.astype(np.float32)).dtype == np.float32


def test_of_singular_matrices() -> None:
    flat = np.array([[1.0, 2, 3], [2, 4, 6], [0, 0, 1]])
    assert determinant(flat) == 0
    assert (flat @ adjugate(flat) == 0).all()


def test_one_is_added_to_the_diagonal_of_a_copy() -> None:
    a = np.zeros((3, 3, 2), dtype=np.float32)
    assert (np.moveaxis(one_plus(a), -1, 0) == np.eye(3)).all()
    assert one_plus(a).dtype == np.float32
    assert not a.any()
