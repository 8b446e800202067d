"""The moving picture of the README: Thompson's drawing of Polyprion deformed until its grid is that of his Antigonia.

From the root of the repository::

    python docs/thompson_picture.py

It writes ``docs/thompson.webp``: at the left the drawing and its grid, moved by one control point for each node; at the
right the drawing of Antigonia, which the deformation does not see. NOTICE says of every picture what it shows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import deformnb as dn
from deformnb.datasets import ThompsonMap, thompson_grid, thompson_map, thompson_plate
from deformnb.volume import Raster
from deformnb.warping import warp_picture

PATH = Path(__file__).parent / "thompson.webp"
SCALE = 0.85  # pixels of the movie per pixel of the scan
FINE = 2  # pixels that are averaged to one, in each direction, so that thin lines stay whole
PAPER = 240  # grey level from which the scan is paper
MARGIN = 8.0  # around the drawings, in pixels of the scan
CAPTION = 24  # rows above the drawings, in pixels of the movie
STEPS = 18  # pictures from one fish to the other
MOMENT, REST = 60, 1600  # milliseconds of a picture, and of the first and the last
WHITE = 255


def place_grids() -> ThompsonMap:
    """Both grids in the coordinates of the drawing of Polyprion, of equal area."""
    nodes = thompson_grid("Polyprion").nodes.reshape(-1, 2)
    (left, top), (right, bottom) = nodes.min(axis=0), nodes.max(axis=0)
    return thompson_map("Polyprion", "Antigonia", box=(left, right, top, bottom), scale="area")


def frame_of(grids: ThompsonMap) -> Raster:
    """The raster of a drawing in the movie, around both grids and the drawing of Polyprion."""
    drawing = thompson_plate("Polyprion").raster
    nodes = np.concatenate([grids.source_nodes, grids.target_nodes]).reshape(-1, 2)
    left, right = drawing.box[:2]
    low = np.minimum(nodes.min(axis=0), [left, nodes[:, 1].min()]) - MARGIN
    high = np.maximum(nodes.max(axis=0), [right, nodes[:, 1].max()]) + MARGIN
    width, height = FINE * np.ceil((high - low) * SCALE).astype(int)
    pixel = 1 / SCALE / FINE
    return Raster((int(height), int(width)), (pixel, pixel), (float(low[0]), float(low[1])))


def drawing_of(name: str) -> NDArray[np.uint8]:
    """The grey values of a drawing, on white paper."""
    return np.minimum(thompson_plate(name).values * (WHITE / PAPER), WHITE).astype(np.uint8)


def morph(grids: ThompsonMap, share: float, raster: Raster) -> NDArray[np.uint8]:
    """Polyprion with its nodes moved by a share, from 0 to 1, of the way to those of Antigonia."""
    drawing = thompson_plate("Polyprion")
    target = grids.source_nodes + share * (grids.target_nodes - grids.source_nodes)
    points = dn.ControlPoints.from_arrays(grids.source_nodes.reshape(-1, 2), target.reshape(-1, 2))
    fit = dn.fit_rbf(points, kernel="thin_plate")
    return warp_picture(drawing_of("Polyprion"), drawing.raster, fit, output=raster, fill=WHITE)


def original(grids: ThompsonMap, raster: Raster) -> NDArray[np.uint8]:
    """The drawing of Antigonia where the map puts its grid: scaled and moved, and not bent."""
    drawing = thompson_plate("Antigonia")
    points = dn.ControlPoints.from_arrays(grids.target.nodes.reshape(-1, 2), grids.target_nodes.reshape(-1, 2))
    fit = dn.fit_rbf(points, kernel="thin_plate")  # of two grids that are similar: its radial part is zero
    return warp_picture(drawing_of("Antigonia"), drawing.raster, fit, output=raster, fill=WHITE)


def sheet(left: NDArray[np.uint8], right: NDArray[np.uint8], share: float) -> Image.Image:
    """Both drawings side by side under their captions."""
    height, width = left.shape[0] // FINE, left.shape[1] // FINE
    page = Image.new("L", (2 * width, height + CAPTION), WHITE)
    for column, (values, caption) in enumerate(
        ((left, f"Polyprion, grid bent by {share:.0%}"), (right, "Antigonia, as Thompson drew it"))
    ):
        page.paste(Image.fromarray(values).reduce(FINE), (column * width, CAPTION))
        draw = ImageDraw.Draw(page)
        draw.text((column * width + width / 2, CAPTION / 2 + 2), caption, 0, ImageFont.load_default(15), anchor="mm")
    return page


def shares() -> NDArray[np.float64]:
    """The shares of the pictures, slow at both ends: there and back again."""
    there = (1 - np.cos(np.linspace(0, np.pi, STEPS + 1))) / 2
    return np.concatenate([there, there[-2:0:-2]])


def main() -> None:
    """Make all pictures and write the file."""
    grids = place_grids()
    raster = frame_of(grids)
    goal = original(grids, raster)
    pages = [sheet(morph(grids, share, raster), goal, share) for share in shares()]
    times = [REST if k in (0, STEPS) else MOMENT for k in range(len(pages))]
    pages[0].save(
        PATH, save_all=True, append_images=pages[1:], duration=times, loop=0, quality=45, method=6, minimize_size=True
    )


if __name__ == "__main__":
    main()
