"""Data sets of pyvista: all point data of an image move, points of meshes go forward."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista

import deformnb as dn
from deformnb.interop import warp_pyvista
from deformnb.rbf.fields import Affine

SHIFT = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))  # output(x) = input(x + 1): tissue goes one to the left


def test_all_point_data_of_an_image_move_by_one_map() -> None:
    image = pyvista.ImageData(dimensions=(4, 2, 2), origin=(5, 0, 0))
    image["grey"] = np.arange(16.0)
    image["colours"] = np.arange(48, dtype=np.uint8).reshape(16, 3)
    result = warp_pyvista(image, SHIFT)
    assert result.origin == image.origin
    inner = np.arange(16).reshape(2, 2, 4)[:, :, :3].ravel()
    assert result["grey"][inner].tolist() == image["grey"][inner + 1].tolist()
    assert np.array_equal(result["colours"][inner], image["colours"][inner + 1])
    assert np.array_equal(image["grey"], np.arange(16.0))  # the one that was given stays


def test_points_go_forward_and_normals_are_left_out() -> None:
    ball = pyvista.Sphere(radius=2.0, theta_resolution=5, phi_resolution=5).compute_normals()
    ball["heat"] = np.arange(float(ball.n_points))
    moved = warp_pyvista(ball, SHIFT)
    assert np.allclose(moved.points, ball.points - [1, 0, 0])
    assert "Normals" in ball.point_data
    assert "Normals" not in moved.point_data
    assert "deformnb_found" not in moved.point_data
    assert np.array_equal(moved["heat"], ball["heat"])


def test_points_without_a_place_stay_and_are_marked() -> None:
    flat = Affine(np.diag([0.0, 1.0, 1.0]), np.zeros(3))  # x + D(x) has x = 0 for every place
    moved = warp_pyvista(pyvista.PolyData([[0.0, 1, 2], [3.0, 1, 2]]), flat)
    assert moved["deformnb_found"].tolist() == [1, 0]
    assert moved.points[1].tolist() == [3, 1, 2]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (pyvista.ImageData(dimensions=(2, 2, 2)), "no point data"),
        (pyvista.RectilinearGrid(), "no points"),
        (pyvista.MultiBlock(), "no points"),
    ],
    ids=["image", "rectilinear", "blocks"],
)
def test_what_cannot_move_is_refused(data: object, said: str) -> None:
    with pytest.raises(dn.DeformError, match=said):
        warp_pyvista(data, SHIFT)
