"""Other programs that read and apply transforms, each in a separate process: ``python peer_programs.py NAME FOLDER``.

Importing ITK's wrappings where warnings are errors ends the process, and two of them in one do not get along. Each
function reads what a test has put into the folder and leaves arrays (.npy, [z, y, x]) and files there.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np


def itk_resample(folder: Path) -> None:
    """Resample volume.nrrd by every transform*.*; write a thin-plate spline and where it maps places.npy."""
    import itk

    image = itk.imread(str(folder / "volume.nrrd"), itk.F)
    for file in sorted(folder.glob("transform.*")):
        if file.name.endswith((".tfm", ".h5")):
            transform = itk.transformread(str(file))[0]
        else:
            stored = itk.imread(str(file))
            vectors = itk.image_from_array(itk.array_from_image(stored).astype(float), is_vector=True)
            vectors.CopyInformation(stored)
            transform = itk.DisplacementFieldTransform[itk.D, 3].New()
            transform.SetDisplacementField(vectors)
        done = itk.resample_image_filter(
            image, transform=transform, reference_image=image, use_reference_image=True, default_pixel_value=-1.0
        )
        np.save(folder / f"{file.name}.npy", itk.array_from_image(done))


def itk_kernels(folder: Path) -> None:
    """Kernel transforms of the landmarks in source.npy and target.npy, and where they map places.npy."""
    import itk

    places = np.load(folder / "places.npy")
    for name in (
        "ThinPlateSplineKernelTransform",
        "ThinPlateR2LogRSplineKernelTransform",
        "VolumeSplineKernelTransform",
    ):
        transform = getattr(itk, name)[itk.D, 3].New()
        for which in ("Source", "Target"):
            container = itk.VectorContainer[itk.IT, itk.Point[itk.D, 3]].New()
            for k, place in enumerate(np.load(folder / f"{which.lower()}.npy").tolist()):
                container.InsertElement(k, place)
            getattr(transform, f"Get{which}Landmarks")().SetPoints(container)
        transform.ComputeWMatrix()
        itk.transformwrite([transform], str(folder / f"{name}.tfm"))
        np.save(folder / f"{name}.npy", np.array([transform.TransformPoint(place) for place in places.tolist()]))


def ants_resample(folder: Path) -> None:
    """Resample volume.nii.gz by every transform*.*; write a matrix, a field and a composite and apply them."""
    import ants

    image = ants.image_read(str(folder / "volume.nii.gz"))

    def resampled(transform: list[str], name: str) -> None:
        done = ants.apply_transforms(image, image, transform, interpolator="linear", defaultvalue=-1.0)
        np.save(folder / f"{name}.npy", done.numpy().T)

    for file in sorted(folder.glob("transform.*")):
        resampled([str(file)], file.name)
    matrix = ants.create_ants_transform(
        "AffineTransform",
        dimension=3,
        matrix=np.load(folder / "matrix.npy"),
        translation=np.load(folder / "offset.npy"),
        center=(7.0, 8.0, 9.0),
    )
    ants.write_transform(matrix, str(folder / "theirs.mat"))
    smooth = np.load(folder / "vectors.npy")  # [z, y, x, 3]
    field = ants.from_numpy(
        np.ascontiguousarray(smooth.transpose(2, 1, 0, 3)),
        image.origin,
        image.spacing,
        image.direction,
        has_components=True,
    )
    ants.image_write(field, str(folder / "theirs.nii.gz"))
    for name in ("theirs.mat", "theirs.nii.gz"):
        resampled([str(folder / name)], name)


def elastix_resample(folder: Path) -> None:
    """Register moving.nrrd to volume.nrrd with several transforms; write their files, and their fields of transformix.

    Apply the fields transform.nii.gz and transform.mha by transformix.
    """
    import itk

    fixed, moving = (itk.imread(str(folder / f"{name}.nrrd"), itk.F) for name in ("volume", "moving"))
    for kind in ("translation", "rigid", "similarity", "affine", "bspline"):
        parameters = itk.ParameterObject.New()
        name = "translation" if kind == "translation" else "rigid" if kind == "similarity" else kind
        table = parameters.GetDefaultParameterMap(name, 1)
        table["Transform"] = ["SimilarityTransform"] if kind == "similarity" else table["Transform"]
        table["MaximumNumberOfIterations"] = ["10"]
        table["FinalGridSpacingInPhysicalUnits"] = ["8"]
        table["ImageSampler"], table["CheckNumberOfSamples"] = ["Full"], ["false"]
        parameters.AddParameterMap(table)
        method = itk.ElastixRegistrationMethod.New(fixed, moving)
        method.SetParameterObject(parameters)
        method.SetLogToConsole(False)
        method.UpdateLargestPossibleRegion()
        found = method.GetTransformParameterObject()
        found.WriteParameterFile(str(folder / f"{kind}.txt"))
        field = itk.transformix_deformation_field(moving, found)
        np.save(folder / f"{kind}.npy", itk.array_from_image(field))
        if kind == "bspline":
            itk.imwrite(field, str(folder / "theirs.mhd"))
            itk.imwrite(field, str(folder / "theirs.nii"))
        if kind == "affine":
            itk.transformix_pointset(
                moving, found, fixed_point_set_file_name=str(folder / "points.txt"), output_directory=str(folder)
            )
    for name in ("transform.nii.gz", "transform.mha"):
        parameters = itk.ParameterObject.New()
        parameters.ReadParameterFile(str(folder / "field.txt"))
        table = dict(parameters.GetParameterMap(0))
        table["DeformationFieldFileName"] = [str(folder / name)]
        applied = itk.ParameterObject.New()
        applied.AddParameterMap(table)
        done = itk.transformix_filter(fixed, applied)
        np.save(folder / f"{name}.npy", itk.array_from_image(done))


def ngff_exchange(folder: Path) -> None:
    """Read the field of ours.zarr as ITK's; write vectors.npy as theirs.zarr, and by an image as beside.zarr."""
    import itk
    import ngff_zarr

    part = "coordinateTransformations/backward_0"
    field = ngff_zarr.from_ome_zarr(str(folder / "ours.zarr" / part))
    given = ngff_zarr.Displacements(path=part, interpolation="linear")
    [made] = ngff_zarr.ngff_displacement_field_to_itk_transform(given, field, ["z", "y", "x"])
    grid = np.asarray(made.fixedParameters)
    np.save(folder / "grid.npy", grid[:9])
    shape = [int(n) for n in grid[:3][::-1]]
    np.save(folder / "ours.npy", np.asarray(made.parameters).reshape(*shape, 3))
    image = itk.image_from_array(np.load(folder / "vectors.npy").astype(float), is_vector=True)
    image.SetOrigin(grid[3:6].tolist())
    image.SetSpacing(grid[6:9].tolist())
    _, alone = ngff_zarr.itk_displacement_field_to_ngff_transform(image, ["z", "y", "x"], path="field")
    levels = ngff_zarr.to_multiscales(alone, scale_factors=[])
    ngff_zarr.to_ome_zarr(str(folder / "theirs.zarr"), ngff_zarr.declare_field_transform(levels), version="0.6")
    given, beside = ngff_zarr.itk_displacement_field_to_ngff_transform(image, ["z", "y", "x"], path="field")
    picture = ngff_zarr.to_multiscales(
        ngff_zarr.to_ngff_image(np.zeros(shape, np.uint8), dims=["z", "y", "x"]), scale_factors=[]
    )
    name = picture.metadata.coordinateSystems[0].name
    picture = ngff_zarr.declare_field_transform(picture, path="field", input_system=name, output_system=name)
    ngff_zarr.to_ome_zarr(str(folder / "beside.zarr"), picture, version="0.6")
    ngff_zarr.to_ome_zarr(
        str(folder / "beside.zarr" / "field"), ngff_zarr.to_multiscales(beside, scale_factors=[]), version="0.6"
    )


def vedo_points(folder: Path) -> None:
    """Read ours.xyz, and write places.npy as theirs.xyz."""
    import vedo

    np.save(folder / "ours.npy", vedo.load(str(folder / "ours.xyz")).coordinates)
    vedo.Points(np.load(folder / "places.npy")).write(str(folder / "theirs.xyz"))


PROGRAMS: dict[str, Any] = {
    program.__name__: program
    for program in (itk_resample, itk_kernels, ants_resample, elastix_resample, ngff_exchange, vedo_points)
}

if __name__ == "__main__":
    PROGRAMS[sys.argv[1]](Path(sys.argv[2]))
