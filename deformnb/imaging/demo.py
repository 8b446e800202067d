"""Demonstration: a fish turned into another one after D'Arcy Thompson, from volume to pictures.

It is also the shortest complete example of the package: load, project, place points, fit, warp, render, save.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Stage
from deformnb.datasets.darcy import HeadSide, ThompsonMap, thompson_grid, thompson_map, thompson_pairs
from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.errors import DeformError
from deformnb.imaging.drawing import draw_pictures
from deformnb.imaging.projection import project
from deformnb.imaging.render import RendererName
from deformnb.volume.plane import Picture, Plane
from deformnb.volume.transfer import otsu_threshold
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import warp_points

# Pixels of the subject: brighter than this share of the range of the picture, in at least this share of a row or
# column. A carp's fins in CT are at 15 % of the range, the noise of the air below 5 %, a stray label a few pixels.
SUBJECT_LEVEL = 0.08
SUBJECT_SHARE = 0.01
_NO_AXIS = 1.3  # ratio of the variances along the principal axes: of a square 1, of a body half as wide as long 4
_ENDS = (0.002, 0.998)  # shares of the pixels of the subject along an axis: some beyond are stray


FILES = ("before.png", "after.png", "thompson.png", "render.png", "volume.nii.gz", "session.json", "warped.nii.gz")
"""Files of the demonstration; volume.nii.gz only where it made the volume itself."""


@dataclass(frozen=True, eq=False)
class Transformation:
    """Result of :func:`transform`: before, after, and the fit between them."""

    volume: Volume
    warped: Volume
    deformation: Deformation
    before: Picture
    after: Picture
    grids: ThompsonMap
    grid_before: list[NDArray[np.float64]]
    grid_after: list[NDArray[np.float64]]

    @property
    def margin(self) -> Float3:
        """Length (x, y, z) that the field of view grew at most on a side: what ``deformnb warp --margin`` takes."""
        grid, grown = self.volume.grid, self.warped.grid
        before = -grid.point_to_index(grown.origin)
        after = np.array(grown.shape[::-1]) - np.array(grid.shape[::-1]) - before
        x, y, z = (np.maximum(before, after).round() * grid.spacing).tolist()
        return x, y, z


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Result of :func:`run_demo`, and the files it wrote with a description each."""

    result: Transformation
    written: list[tuple[str, Path]]


def _grey(picture: Picture) -> NDArray[np.float64]:
    """The values of a picture; of one in colour the largest of each pixel's."""
    values = np.asarray(picture.values, dtype=np.float64)
    return values if values.ndim == 2 else values.max(axis=-1)


def subject_axes(picture: Picture, margin: float = 0.02) -> tuple[NDArray[np.float64], ...]:
    """Centre of the foreground of a picture, and half of its length and of its width along its principal axes.

    The foreground is above Otsu's threshold. The axes are the eigenvectors of the second moments of its pixels (M.-K.
    Hu, IRE Trans. Information Theory 8 (1962) 179-187). Where these define no direction, as of a disc, the axes are
    those of the picture.

    Returns
    -------
    Three vectors (2,) in units of the picture: the middle, the half of the longer side, and that of the shorter one.

    Raises
    ------
    DeformError
        Where there is no foreground, or it is too thin.

    Examples
    --------
    >>> line, column = np.mgrid[:60, :60] - 30
    >>> bar = (np.abs(2 * line - column) < 24) & (np.abs(line + 2 * column) < 60)  # two to the right for one down
    >>> picture = project(Volume.from_array(100 * bar[None].astype(np.uint8)), "+z")
    >>> [axis.round().tolist() for axis in subject_axes(picture)]
    [[30.0, 30.0], [25.0, 12.0], [-5.0, 10.0]]
    """
    a0, a1, b0, b1 = subject_box(picture, margin)  # whose errors are this function's too
    b, a = np.meshgrid(picture.raster.rows, picture.raster.columns, indexing="ij")
    values = np.clip(_grey(picture), *picture.window)  # metal would be a separate class
    inside = (values > otsu_threshold(values)) & (a >= a0) & (a <= a1) & (b >= b0) & (b <= b1)
    places = np.stack([a[inside], b[inside]], axis=1)
    variances, vectors = np.linalg.eigh(np.cov(places.T))
    if variances[1] < _NO_AXIS * variances[0]:
        half = np.diag([a1 - a0, b1 - b0]) / 2
        long, short = half if half[0, 0] >= half[1, 1] else half[::-1]
        return np.array([a0 + a1, b0 + b1]) / 2, long, short
    axes = vectors.T[::-1]
    axes = axes * np.sign(axes[np.arange(2), np.abs(axes).argmax(axis=1)])[:, None]  # right and down
    low, high = np.quantile(places @ axes.T, _ENDS, axis=0)
    half = (1 + 2 * margin) * (high - low) / 2
    if not (half > 0).all():
        raise DeformError("the subject of the picture is too thin to lay a grid around.")
    return axes.T @ ((low + high) / 2), half[0] * axes[0], half[1] * axes[1]


def subject_box(picture: Picture, margin: float = 0.02) -> tuple[float, float, float, float]:
    """The box (a_min, a_max, b_min, b_max) around the foreground of a picture, grown by a share of its size."""
    values = _grey(picture)
    bright = values > values.min() + SUBJECT_LEVEL * np.ptp(values)
    edges = []
    for lines, axis in ((picture.raster.columns, 0), (picture.raster.rows, 1)):
        found = lines[bright.mean(axis=axis) > SUBJECT_SHARE]
        if len(found) == 0:
            raise DeformError("there is nothing on the picture to lay a grid around: all pixels are equal.")
        grow = margin * (found[-1] - found[0])
        edges += [float(found[0] - grow), float(found[-1] + grow)]
    if edges[1] <= edges[0] or edges[3] <= edges[2]:
        raise DeformError("the subject of the picture is too thin to lay a grid around.")
    return edges[0], edges[1], edges[2], edges[3]


def source_figure(species: str) -> str:
    """The figure that Thompson drew next to a species, as the source of the map.

    Examples
    --------
    >>> source_figure("Orthagoriscus")
    'Diodon'
    """
    name = thompson_grid(species).species
    partners = {target: source for source, target in thompson_pairs()}
    return partners.get(name, "Polyprion")


def transform(
    volume: Volume,
    *,
    species: str = "Antigonia",
    source: str | None = None,
    view: ViewName = "-x",
    head: HeadSide = "left",
    stage: Stage,
) -> Transformation:
    """Transform the animal of a volume into another of Thompson's species.

    Parameters
    ----------
    volume : a fish, or anything else, seen from the side along ``view``.
    species, source : Thompson's names of the target and source figures; by default the one he drew next to it.
    view : direction of looking; head : where the head then points, "left" or "right".
    stage : announces each piece of work and takes its progress.

    Notes
    -----
    The grid preserves its area, as in Thompson's drawings; the field of view grows to hold it. The displacement of the
    picture is replicated through the body, so nothing changes along the direction of looking.
    """
    plane = Plane.from_view(volume.grid, view)
    before = project(volume, plane, "mip", progress=stage("project it from the side"))
    source = source or source_figure(species)
    grids = thompson_map(source, species, box=subject_box(before), scale="area", head=head)
    deformation = Deformation.from_picture_points(volume.grid, plane, grids.points, name=f"{source} -> {species}")
    deformation = Deformation(deformation.steps, deformation.name, VolumeReference.of(volume))
    output = field_of_view(volume.grid, plane, grids)
    warped = deformation.apply(volume, output=output, progress=stage("deform it"))
    after = project(warped, plane, "mip", progress=stage("project the result"))
    lines = [subdivide(line) for line in grids.polylines()[0]]
    bent = deformed_grid(lines, deformation, volume)
    return Transformation(volume, warped, deformation, before, after, grids, lines, bent)


def subdivide(line: NDArray[np.float64], parts: int = 12) -> NDArray[np.float64]:
    """A polyline with each piece cut into equal parts, so that it can bend."""
    at = np.linspace(0, len(line) - 1, (len(line) - 1) * parts + 1)
    return np.stack([np.interp(at, np.arange(len(line)), line[:, k]) for k in range(2)], axis=-1)


def deformed_grid(
    lines: list[NDArray[np.float64]], deformation: Deformation, volume: Volume
) -> list[NDArray[np.float64]]:
    """Lines of a grid on the picture after the deformation: forward, by inverting the backward map."""
    (fit,) = deformation.steps[0].fits(volume.grid)
    moved, _ = warp_points(np.concatenate(lines), fit)
    return np.split(moved, np.cumsum([len(line) for line in lines])[:-1])


def field_of_view(grid: Grid, plane: Plane, grids: ThompsonMap) -> Grid:
    """The volume's grid with voxels added so that the whole target grid is inside."""
    rim = np.zeros((grids.target_nodes.reshape(-1, 2).shape[0], 3))
    rim[:, :2] = grids.target_nodes.reshape(-1, 2)
    rim[:, 2] = plane.to_plane(grid.center)[2]
    return grid.cover(plane.from_plane(rim))


def write_pictures(result: Transformation, folder: Path) -> list[Path]:
    """The picture before and after, each with its grid, and both on one page."""
    grids = (result.grid_before, result.grid_after)
    pictures = (result.before, result.after)
    titles = (
        f"{result.volume.name or 'volume'}, on the grid of {result.grids.source.species}",
        f"the same, on the grid of {result.grids.target.species}",
    )
    before, after, both = paths = [folder / name for name in FILES[:3]]
    for k, path in enumerate((before, after)):
        draw_pictures([pictures[k]], grids=[grids[k]], titles=[titles[k]], path=path)
    draw_pictures(pictures, grids=grids, titles=titles, path=both)
    return paths


def check_demo(species: str, view: ViewName, renderer: RendererName) -> None:
    """DeformError for errors that would else be noticed after the work: an unknown name, a broken renderer."""
    from deformnb.imaging.render import find_renderer

    thompson_map(source_figure(species), species)
    Plane.from_view(Grid((1, 1, 1)), view)
    find_renderer(renderer)


def run_demo(
    folder: Path,
    *,
    volume: Volume | None = None,
    species: str = "Antigonia",
    view: ViewName = "-x",
    head: HeadSide = "left",
    renderer: RendererName = "auto",
    stage: Stage,
) -> Demonstration:
    """Make everything that ``deformnb demo`` shows.

    Parameters
    ----------
    folder : where the results go.
    volume : default is the phantom of a carp, which needs no download.
    species, view, head : see :func:`transform`.
    renderer : a name of :data:`~deformnb.imaging.render.RENDERERS`, or "auto".

    Raises
    ------
    DeformError
        For an unknown name, or a volume on which nothing is to be seen.
    """
    from deformnb.datasets import PHANTOMS
    from deformnb.imaging.render import render_pair
    from deformnb.io import write_volume
    from deformnb.io.documents import write_deformation

    check_demo(species, view, renderer)
    own = volume is None
    if volume is None:
        volume = PHANTOMS["fish"].make((256, 512, 256), progress=stage("make a carp"))
    result = transform(volume, species=species, view=view, head=head, stage=stage)
    before, after, both = write_pictures(result, folder)
    render, carp, session, warped = (folder / name for name in FILES[3:])
    captions = (volume.name or "before", f"on the grid of {result.grids.target.species}")
    direction, up = _quarter_view(result)
    render_pair(
        result.volume,
        result.warped,
        path=render,
        direction=direction,
        up=up,
        backend=renderer,
        captions=captions,
        progress=stage("render both volumes"),
    )
    write_deformation(result.deformation, session, overwrite=True)  # the caller has checked the existing files
    if own:
        write_volume(volume, carp, progress=stage("write the carp"))
    write_volume(result.warped, warped, progress=stage("write the deformed volume"))
    written = [
        ("picture before, with its grid", before),
        ("picture after, with its grid", after),
        ("both pictures", both),
        ("volume before and after", render),
        ("deformed volume", warped),
        ("session: the steps", session),
    ]
    return Demonstration(result, [*written, ("the carp itself", carp)] if own else written)


def _quarter_view(result: Transformation) -> tuple[Float3, Float3]:
    """Direction and up: at the side of the picture, turned a little to the front and from above, to show depth."""
    plane = result.deformation.steps[0].plane
    assert plane is not None
    u, v, n = plane.frame
    x, y, z = (n + 0.45 * u + 0.25 * v).tolist()
    a, b, c = (-v).tolist()
    return (x, y, z), (a, b, c)
