"""Command ``deformnb transform``: a session, or a transform file, written for ITK, ANTs, 3D Slicer and elastix."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from deformnb.cli.warp import add_spacing, note, stages
from deformnb.errors import DeformError


def add_transform(commands: Any) -> None:
    """Add the command to argparse's commands."""
    p = commands.add_parser(
        "transform", help="write a session as a transform of ITK, ANTs or 3D Slicer",
        usage="deformnb transform SESSION VOLUME OUTPUT [options]",
        description="""Write the deformation of a session as a transform file, or one transform file as another. It maps
        backward: places of the result to places of the input, as resampling programs expect.""")
    p.add_argument("session", help="a document written by deformnb (.json), or a transform file")
    p.add_argument("volume", help="the volume that is deformed; its voxels are the samples of the displacements")
    p.add_argument("output", help="ends with .tfm or .h5 (ITK's transforms), or with .nrrd, .nii.gz or .mha "
                   "(displacements)")
    p.add_argument("--inverse", metavar="FILE", help="also write the inverse, which maps forward and carries points")
    p.add_argument("--strength", type=float, default=1.0, help="1 as saved, 0 not at all, 2 exaggerated, -1 opposite")
    add_spacing(p)
    p.add_argument("--force", action="store_true", help="overwrite files that are there")
    p.set_defaults(run=_transform)


def _transform(options: argparse.Namespace) -> None:
    from deformnb.io.documents import read_deformation
    from deformnb.io.transforms import is_transform, read_transform, write_transform
    from deformnb.session.inputs import grid_of_file
    from deformnb.warping.inverse import invert

    grid = grid_of_file(options.volume, options.spacing)
    if is_transform(options.session):
        if options.strength != 1:
            raise DeformError("--strength is for sessions, and a transform file is none.")
        field = read_transform(options.session, grid)
    else:
        document = read_deformation(options.session)
        note(*document.notes(grid))
        own = document.own_grid(grid)
        if own != grid:
            raise DeformError("the session was made when this volume had another spacing, and a transform would not "
                              "fit what other programs read in its file; state the session's with --spacing.")
        field = document.scaled(options.strength).field(grid)
    with stages() as stage:
        write_transform(field, options.output, grid, overwrite=options.force,
                        progress=stage(f"write {Path(options.output).name}"))
        print(options.output)
        if options.inverse:
            inverse = invert(field, grid, progress=stage("invert"))
            note(f"the inverse reaches {100 * inverse.share:.4g} % of the voxels within {inverse.tolerance:.3g}")
            write_transform(inverse, options.inverse, grid, overwrite=options.force)
            print(options.inverse)
