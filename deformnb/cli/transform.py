"""Command ``deformnb transform``: a session, or a transform file, written for ITK, ANTs, elastix, VTK or OME-NGFF."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deformnb.cli.session_input import STANDARD_INPUT, read_session, refuse_pipes
from deformnb.cli.warp import add_spacing, note, stages
from deformnb.devices import add_device
from deformnb.errors import DeformError

if TYPE_CHECKING:
    from deformnb.volume.volume import Grid


def add_transform(commands: Any) -> None:
    """Add the command to argparse's commands."""
    p = commands.add_parser(
        "transform",
        help="write a session as a transform of ITK, ANTs, 3D Slicer, VTK or OME-NGFF",
        usage="deformnb transform SESSION VOLUME OUTPUT [options]",
        description="""Write the deformation of a session as a transform file, or one transform file as another. It maps
        backward: places of the result to places of the input, as resampling programs expect.""",
    )
    p.add_argument(
        "session", help="a document written by deformnb (.json; - is one from standard input), or a transform file"
    )
    p.add_argument("volume", help="the volume that is deformed; its voxels are the samples of the displacements")
    p.add_argument(
        "output",
        help="ends with .tfm or .h5 (ITK's transforms), with .nrrd, .nii.gz, .mha or .vti "
        "(displacements), or with .zarr (OME-NGFF)",
    )
    p.add_argument(
        "--inverse",
        metavar="FILE",
        nargs="?",
        const="",
        help="also write the inverse, which maps forward "
        "and carries points; by default next to the output, with _forward in its name",
    )
    p.add_argument(
        "--every", type=int, default=1, metavar="N", help="sample the displacements at every n-th voxel along each axis"
    )
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    add_spacing(p)
    add_device(p)
    p.add_argument("--force", action="store_true", help="overwrite files that are there")
    p.set_defaults(run=_transform)


def _transform(options: argparse.Namespace) -> None:
    from deformnb.io.transforms.formats import check_transform_target, is_transform, read_transform, write_transform
    from deformnb.io.transforms.remarks import read_remark
    from deformnb.session.inputs import grid_of_file
    from deformnb.warping.inverse import invert

    refuse_pipes((options.volume, options.output))
    grid = grid_of_file(options.volume, options.spacing)
    direction: Any = "backward"
    if options.session != STANDARD_INPUT and is_transform(options.session, images=True):
        if options.strength != 1:
            raise DeformError("--strength is for sessions, and a transform file is none.")
        field = read_transform(options.session, grid)
        direction = read_remark(Path(options.session)).partition(":")[0] or direction
    else:
        document = read_session(options.session)
        note(*document.notes(grid))
        own = document.own_grid(grid)
        if own != grid:
            raise DeformError(
                "the session was made when this volume had another spacing, and a transform would not "
                "fit what other programs read in its file; state the session's with --spacing."
            )
        field = document.scaled(options.strength).field(grid)
    lattice = _every(grid, options.every)
    check_transform_target(options.output, overwrite=options.force)
    beside = options.inverse
    if beside is not None:
        if direction == "forward":
            raise DeformError(f"{Path(options.session).name} states a forward map; --inverse is for backward maps.")
        beside = Path(beside) if beside else _forward_name(Path(options.output))
        check_transform_target(beside, overwrite=options.force)
    with stages() as stage:
        write_transform(
            field,
            options.output,
            lattice,
            direction=direction,
            overwrite=options.force,
            progress=stage(f"write {Path(options.output).name}"),
        )
        note(
            "it maps backward, from places of the result to places of the input"
            if direction == "backward"
            else "it maps forward, as its source states: from places of the input to places of the result"
        )
        print(options.output)
        if beside is not None:
            inverse = invert(field, lattice, progress=stage("invert"))
            note(
                f"the inverse maps forward, and reaches {100 * inverse.share:.4g} % of the voxels within "
                f"{inverse.tolerance:.3g}"
            )
            write_transform(inverse, beside, lattice, overwrite=options.force)
            print(beside)


def _every(grid: Grid, step: int) -> Grid:
    """The grid of every n-th voxel, as large as the whole or a little larger."""
    if step < 1:
        raise DeformError(f"--every is a whole number from 1 on, got {step}.")
    nz, ny, nx = (-(-(n - 1) // step) + 1 for n in grid.shape)
    a, b, c = (step * s for s in grid.spacing)
    return replace(grid, shape=(nz, ny, nx), spacing=(a, b, c))


def _forward_name(path: Path) -> Path:
    from deformnb.io.transforms.formats import TRANSFORM_SUFFIXES

    suffix = next(s for s in TRANSFORM_SUFFIXES if path.name.lower().endswith(s))
    return path.with_name(f"{path.name[: -len(suffix)]}_forward{path.name[-len(suffix) :]}")
