"""Transform files: SimpleITK resamples with ours to the same voxels, and those that it writes are applied here."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import h5py
import nibabel
import numpy as np
import pytest
import scipy.io
import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)
from format_table import bound
from scipy.spatial.distance import cdist

import deformnb as dn
from deformnb.cli.main import main
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.io.transforms.formats import describe_transform, read_transform, write_transform
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks

_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
GRID = Grid((14, 18, 22), (1.5, 1.0, 2.0), (5.0, -30.0, 12.0), tuple(map(tuple, _TURN.tolist())))
RANDOM = np.random.default_rng(5)
VOLUME = Volume(RANDOM.uniform(0, 255, GRID.shape).astype(np.float32), GRID)
POINTS = GRID.index_to_point(RANDOM.uniform(3, 10, (60, 3)))
AFFINE = Affine(np.eye(3) + RANDOM.uniform(-0.04, 0.04, (3, 3)), np.array([0.5, -0.8, 0.3]))


def _bend(scale: float = 1.0) -> AbstractField:
    at = GRID.index_to_point([[2, 2, 2], [18, 3, 4], [4, 14, 5], [9, 8, 11], [16, 13, 6]])
    return dn.fit_rbf(
        dn.ControlPoints.from_arrays(
            at, at + scale * np.array([[1, 0, 2], [0, -1, 1], [2, 1, 0], [-1, 2, -1], [0, 0, 2]])
        ),
        support=30.0,
    )


def _resample(transform: Any) -> np.ndarray:
    image = VOLUME.to_sitk()
    return sitk.GetArrayFromImage(sitk.Resample(image, image, transform, sitk.sitkLinear, -1.0))


def _itk(path: Path) -> Any:
    """The transform that SimpleITK reads of a file."""
    if path.name.endswith((".tfm", ".h5")):
        return sitk.ReadTransform(str(path))
    return sitk.DisplacementFieldTransform(sitk.ReadImage(str(path), sitk.sitkVectorFloat64))


LIMITS = {
    ".tfm": bound("transforms", "itk text", "SimpleITK"),
    ".h5": bound("transforms", "itk hdf5", "SimpleITK"),
    ".nrrd": bound("transforms", "nrrd", "SimpleITK"),
    ".nii.gz": bound("transforms", "nifti", "SimpleITK"),
    ".mha": bound("transforms", "metaimage", "SimpleITK"),
}


@pytest.mark.parametrize("suffix", LIMITS)
def test_simpleitk_resamples_what_is_written_to_the_same_voxels(suffix: str, tmp_path: Path) -> None:
    field, path = _bend(), tmp_path / f"bend{suffix}"
    write_transform(field, path, GRID)
    known = dn.warp(VOLUME, DisplacementField.sample(field, GRID), fill=-1.0).values
    found = _resample(_itk(path))
    inside = (known != -1) & (found != -1)
    assert inside.mean() > 0.5
    assert (inside == (known != -1)).mean() > 0.995  # at the very border either may round outwards
    assert np.abs(known - found)[inside].max() < LIMITS[suffix]
    again = read_transform(path)
    assert np.abs(again.displacement(POINTS) - DisplacementField.sample(field, GRID).displacement(POINTS)).max() < 1e-5
    head = gzip.decompress(path.read_bytes()) if suffix == ".nii.gz" else path.read_bytes()
    assert b"backward" in head[:4000]
    with pytest.raises(DeformError, match=r"bend"):
        write_transform(field, path, GRID, overwrite=False)


@pytest.mark.parametrize("suffix", [".tfm", ".h5"])
def test_a_composition_keeps_its_parts(suffix: str, tmp_path: Path) -> None:
    both = dn.rbf.compose(_bend(), AFFINE, _bend(-0.5))
    path = tmp_path / f"both{suffix}"
    write_transform(both, path, GRID)
    found = _itk(path)
    assert found.GetName() == "CompositeTransform"
    assert sitk.CompositeTransform(found).GetNumberOfTransforms() == 3
    there = np.array([found.TransformPoint(tuple(p)) for p in POINTS.tolist()])
    assert np.abs(there - (POINTS + both.displacement(POINTS))).max() < 0.02  # linear between the samples
    again = read_transform(path)
    assert [type(part) for part in again.steps] == [DisplacementField, Affine, DisplacementField]
    assert np.abs(again.displacement(POINTS) - (there - POINTS)).max() < 1e-6


def _euler() -> Any:
    made = sitk.Euler3DTransform((3.0, -20.0, 15.0), 0.2, -0.1, 0.3)
    made.SetTranslation((1.0, 2.0, -1.5))
    return made


def _similarity() -> Any:
    return sitk.Similarity3DTransform(1.2, (0.0, 0.0, 1.0), 0.4, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def _spline() -> Any:
    made = sitk.BSplineTransformInitializer(VOLUME.to_sitk(), [3, 3, 3])
    made.SetParameters(RANDOM.uniform(-0.5, 0.5, len(made.GetParameters())).tolist())
    return made


ITK = {
    "identity": lambda: sitk.Transform(3, sitk.sitkIdentity),
    "translation": lambda: sitk.TranslationTransform(3, (1.0, -2.0, 3.0)),
    "euler": _euler,
    "similarity": _similarity,
    "affine": lambda: sitk.AffineTransform(AFFINE.matrix.ravel().tolist(), AFFINE.offset.tolist(), (7.0, 8.0, 9.0)),
    "b-spline": _spline,
    "composite": lambda: sitk.CompositeTransform([_euler(), _spline(), _similarity()]),
}


@pytest.mark.parametrize("kind", ITK)
def test_what_simpleitk_writes_is_the_same_map_here(kind: str, tmp_path: Path) -> None:
    made, path = ITK[kind](), tmp_path / "theirs.h5"
    sitk.WriteTransform(made, str(path))
    places = GRID.index_to_point(RANDOM.uniform(-3, 25, (300, 3)))  # also beyond the domain of the spline
    there = np.array([made.TransformPoint(tuple(p)) for p in places.tolist()])
    assert np.abs(places + read_transform(path).displacement(places) - there).max() < 1e-9


def test_a_matrix_of_ants_is_an_affine_map_about_its_centre(tmp_path: Path) -> None:
    centre, offset = np.array([7.0, 8.0, 9.0]), np.array([1.0, 2.0, 3.0])
    numbers = np.concatenate([AFFINE.matrix.ravel(), offset])[:, None]
    scipy.io.savemat(tmp_path / "a.mat", {"AffineTransform_double_3_3": numbers, "fixed": centre[:, None]}, format="4")
    known = (POINTS - centre) @ AFFINE.matrix.T + centre + offset
    assert np.abs(POINTS + read_transform(tmp_path / "a.mat").displacement(POINTS) - known).max() < 1e-9
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(data[:4] + b"\xff\xff\xff\x7f" + data[8:])
    with pytest.raises(VolumeFileError, match="sizes do not agree"):
        read_transform(tmp_path / "a.mat")


@pytest.mark.parametrize(("intent", "sign"), [(1007, 1), (1006, -1)])
def test_vectors_of_nifti_are_lps_and_displacement_vectors_ras(intent: int, sign: int, tmp_path: Path) -> None:
    values = RANDOM.normal(size=(4, 5, 6, 3))
    stored = np.ascontiguousarray(values.transpose(2, 1, 0, 3)[:, :, :, None]) * [sign, sign, 1]
    image = nibabel.Nifti1Image(stored.astype(np.float32), np.diag([-1.5, -2.0, 3.0, 1.0]))
    image.header.set_intent(intent)
    nibabel.save(image, tmp_path / "a.nii")
    field = read_transform(tmp_path / "a.nii")
    assert isinstance(field, DisplacementField)
    assert (field.lattice.spacing, field.lattice.shape) == ((1.5, 2.0, 3.0), (4, 5, 6))
    assert np.abs(np.asarray(field.values) - values).max() < bound("transforms", "nifti", "nibabel")
    write_transform(field, tmp_path / "b.nii", field.lattice)  # type: ignore[arg-type]
    again = nibabel.load(tmp_path / "b.nii")
    assert (again.header["intent_code"], again.shape) == (1007, (6, 5, 4, 1, 3))
    found = np.asarray(again.dataobj)[:, :, :, 0].transpose(2, 1, 0, 3)
    assert np.abs(found - values).max() < bound("transforms", "nifti", "nibabel")
    assert b"backward" in bytes(again.header["descrip"])


ELASTIX = {
    "TranslationTransform": ([1.0, -2.0, 3.0], lambda c: sitk.TranslationTransform(3, (1.0, -2.0, 3.0))),
    "EulerTransform": (
        [0.1, 0.2, -0.3, 1.0, 2.0, 3.0],
        lambda c: sitk.Euler3DTransform(c, 0.1, 0.2, -0.3, (1.0, 2.0, 3.0)),
    ),
    "SimilarityTransform": (
        [0.0, 0.0, float(np.sin(0.2)), 4.0, 5.0, 6.0, 1.2],
        lambda c: sitk.Similarity3DTransform(1.2, (0.0, 0.0, 1.0), 0.4, (4.0, 5.0, 6.0), c),
    ),
    "AffineTransform": (
        [*AFFINE.matrix.ravel().tolist(), 1.0, 2.0, 3.0],
        lambda c: sitk.AffineTransform(AFFINE.matrix.ravel().tolist(), (1.0, 2.0, 3.0), c),
    ),
}


@pytest.mark.parametrize("kind", ELASTIX)
def test_parameter_files_of_elastix(kind: str, tmp_path: Path) -> None:
    """Literal files; those that elastix writes are read in test_peers.py. The initial transform is applied first."""
    centre = (3.0, -20.0, 15.0)
    numbers, make = ELASTIX[kind]
    (tmp_path / "first.txt").write_text(
        '(Transform "TranslationTransform")\n(NumberOfParameters 3)\n(TransformParameters 5 0 -5)\n'
        '(InitialTransformParametersFileName "NoInitialTransform")\n(FixedImageDimension 3)\n',
        encoding="utf-8",
    )
    (tmp_path / "second.txt").write_text(
        f'// made by hand\n(Transform "{kind}")\n(TransformParameters {" ".join(map(repr, numbers))})\n'
        f"(CenterOfRotationPoint {' '.join(map(str, centre))})\n(FixedImageDimension 3) // three\n"
        '(InitialTransformParameterFileName "/elsewhere/first.txt")\n(HowToCombineTransforms "Compose")\n',
        encoding="utf-8",
    )
    known = np.array([make(centre).TransformPoint(tuple(p)) for p in (POINTS + np.array([5.0, 0.0, -5.0])).tolist()])
    found = POINTS + read_transform(tmp_path / "second.txt").displacement(POINTS)
    assert np.abs(found - known).max() < 1e-9
    text = (tmp_path / "second.txt").read_text(encoding="utf-8")
    for old, new, words in (
        (kind, "RecursiveBSplineTransform", "is not read"),
        ("Parameters ", "Parameters 1 ", "given"),
        ("Compose", "Add", "only compositions"),
        ("first", "none", "missing"),
        ("first", "second", "names itself"),
        ("Dimension 3", "Dimension 2", "2 dimensions"),
    ):
        (tmp_path / "second.txt").write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(VolumeFileError, match=words):
            read_transform(tmp_path / "second.txt")


def test_a_spline_of_elastix_is_that_of_itk_with_the_columns_of_its_direction(tmp_path: Path) -> None:
    size, origin, spacing = (5, 6, 7), (-30.0, -40.0, -20.0), (20.0, 18.0, 16.0)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    numbers = np.random.default_rng(4).normal(size=3 * 5 * 6 * 7)
    known = sitk.BSplineTransform(3, 3)
    known.SetFixedParameters([*size, *origin, *spacing, *turn.ravel().tolist()])
    known.SetParameters(numbers.tolist())
    path = tmp_path / "spline.txt"
    text = '(Transform "BSplineTransform")\n(FixedImageDimension 3)\n' + "".join(
        f"({key} {' '.join(map(repr, values))})\n"
        for key, values in (
            ("TransformParameters", numbers.tolist()),
            ("GridSize", size),
            ("GridOrigin", origin),
            ("GridSpacing", spacing),
            ("GridDirection", turn.T.ravel().tolist()),
        )
    )
    path.write_text(text, encoding="utf-8")
    places = np.array(origin) + np.random.default_rng(5).uniform(36, 44, (20, 3)) @ turn.T
    moves = np.array([known.TransformPoint(tuple(p)) for p in places.tolist()]) - places
    assert np.abs(moves).min() > 0
    assert np.abs(read_transform(path).displacement(places) - moves).max() < 1e-9
    for old, new, words in (("(GridSize 5", "(GridSize", "three numbers each"), ("(GridSize 5", "(GridSize 4", "504")):
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(VolumeFileError, match=words):
            read_transform(path)


def test_kernel_transforms_interpolate_the_landmarks_of_the_file(tmp_path: Path) -> None:
    """The thin-plate spline of ITK in space: the kernel r and an affine part, solved here literally."""
    source, target = RANDOM.uniform(0, 20, (9, 3)), RANDOM.uniform(0, 20, (9, 3))
    path = tmp_path / "spline.tfm"
    lines = [" ".join(map(repr, places.ravel().tolist())) for places in (source, target)]
    path.write_text(
        "#Insight Transform File V1.0\n#Transform 0\nTransform: ThinPlateSplineKernelTransform_double_3_3\n"
        f"Parameters: {lines[0]}\nFixedParameters: {lines[1]}\n",
        encoding="utf-8",
    )
    basis = np.column_stack([np.ones(9), source])
    system = np.block([[cdist(source, source), basis], [basis.T, np.zeros((4, 4))]])
    weights = np.linalg.solve(system, np.vstack([target - source, np.zeros((4, 3))]))
    places = RANDOM.uniform(-5, 25, (30, 3))
    known = np.column_stack([cdist(places, source), np.ones(30), places]) @ weights
    assert np.abs(read_transform(path).displacement(places) - known).max() < 1e-7


def test_an_inverse_says_that_it_is_forward_and_how_well_it_was_found(tmp_path: Path) -> None:
    field, shares = DisplacementField.sample(_bend(), GRID), list[float]()
    write_transform(field, tmp_path / "there.h5", GRID, inverse=tmp_path / "back.nrrd", progress=shares.append)
    assert (shares == sorted(shares), shares[-1]) == (True, 1.0)
    assert (tmp_path / "there.h5").read_bytes().startswith(b"backward: ")
    remark = sitk.ReadImage(str(tmp_path / "back.nrrd")).GetMetaData("deformnb_transform")
    assert remark.startswith("forward: ")
    assert "residual" in remark
    forth = POINTS + field.displacement(POINTS)
    assert np.abs(forth + read_transform(tmp_path / "back.nrrd").displacement(forth) - POINTS).max() < 0.3
    with pytest.raises(VolumeFileError, match=r"back\.nrrd"):  # and there.h5 is not replaced before
        write_transform(field, tmp_path / "other.h5", GRID, inverse=tmp_path / "back.nrrd", overwrite=False)
    assert not (tmp_path / "other.h5").exists()


@pytest.mark.parametrize("suffix", ["tfm", "h5", "nrrd", "nii.gz", "mha", "vti", "zarr"])
def test_a_file_is_described_with_the_direction_of_its_map(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = DisplacementField.sample(_bend(), GRID)
    dn.write_volume(VOLUME, tmp_path / "v.nrrd")
    names = [tmp_path / f"{name}.{suffix}" for name in ("there", "back", "again")]
    write_transform(field, names[0], GRID, inverse=names[1])
    assert main(["transform", str(names[1]), str(tmp_path / "v.nrrd"), str(names[2])]) == 0  # and stays unchanged
    assert "it maps forward, as its source states" in capsys.readouterr().err
    for path, direction in zip(names, ("backward", "forward", "forward"), strict=True):
        assert main(["info", str(path)]) == 0
        rows = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
        assert rows["maps"].startswith(f"{direction}: from places of the ")
        assert "22 x 18 x 14 nodes" in describe_transform(path)["part 1"]
    assert main(["transform", str(names[1]), str(tmp_path / "v.nrrd"), str(tmp_path / f"c.{suffix}"), "--inverse"]) == 2


def test_what_others_wrote_is_described_by_its_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    both = sitk.CompositeTransform(
        [
            sitk.AffineTransform(np.diag([2.0, 1, 1]).ravel().tolist(), (1, 0, 0)),
            sitk.TranslationTransform(3, (1, 2, 3)),
        ]
    )
    sitk.WriteTransform(both, str(tmp_path / "both.txt"))  # an ending that landmarks have too
    rows = describe_transform(tmp_path / "both.txt")
    assert rows["maps"] == "backward, as transforms for resampling do; the file does not state it"
    assert {rows["part 1"], rows["part 2"]} == {
        "affine map, which makes volumes 0.5 times as large",
        "affine map, which makes volumes 1 times as large",
    }
    assert main(["info", str(tmp_path / "both.txt")]) == 0
    assert "affine map" in capsys.readouterr().out
    (tmp_path / "marks.txt").write_text("point\n1\n1 2 3\n", encoding="utf-8")
    assert main(["info", str(tmp_path / "marks.txt")]) == 0
    assert "landmarks  1" in capsys.readouterr().out


def test_a_text_that_could_not_be_read_again_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.io.transforms.itk_files.LONGEST_ITK_TEXT", 10_000)
    with pytest.raises(VolumeFileError, match=r"a\.tfm: a text of .* is too long .* write it as \.h5"):
        write_transform(_bend(), tmp_path / "a.tfm", GRID)
    assert not list(tmp_path.iterdir())


def test_points_follow_a_transform_and_volumes_are_warped_by_it_in_parts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = DisplacementField.sample(_bend(), GRID)
    write_transform(field, tmp_path / "there.nii.gz", GRID, inverse=tmp_path / "back.h5")
    dn.write_volume(VOLUME, tmp_path / "v.zarr")
    marks = Landmarks(GRID.index_to_point(np.array([[5.0, 6, 7], [12, 9, 5]])))
    write_landmarks(marks, tmp_path / "marks.fcsv")
    volume, there, out = (str(tmp_path / name) for name in ("v.zarr", "there.nii.gz", "moved.fcsv"))
    assert main(["warp", there, str(tmp_path / "marks.fcsv"), out, "--volume", volume]) == 0
    moved = read_landmarks(out).points
    assert np.abs(moved + read_transform(there).displacement(moved) - marks.points).max() < 1e-3
    assert main(["warp", there, volume, str(tmp_path / "warped.zarr"), "--memory", "50 MB"]) == 0
    known = dn.warp(VOLUME, read_transform(there))
    assert np.abs(dn.read_volume(tmp_path / "warped.zarr").values - known.values).max() < 1e-3
    capsys.readouterr()
    back = str(tmp_path / "back.h5")
    assert main(["warp", back, volume, str(tmp_path / "undone.nrrd")]) == 0
    assert "inverts that transform" in capsys.readouterr().err
    assert main(["warp", back, str(tmp_path / "marks.fcsv"), str(tmp_path / "m.fcsv"), "--volume", volume]) == 2
    assert "states a forward map; name the backward" in capsys.readouterr().err


def test_what_is_no_transform_is_refused(tmp_path: Path) -> None:
    text, image = tmp_path / "a.tfm", tmp_path / "b.nrrd"
    text.write_text("#Insight Transform File V1.0\nTransform: Nonsense_double_3_3\n", encoding="utf-8")
    dn.write_volume(VOLUME, image)
    for path, words in (
        (text, "Nonsense_double_3_3 is not read"),
        (image, "three components"),
        (tmp_path / "none.h5", "no such file"),
        (tmp_path / "d.json", "no such file"),
        (tmp_path / "d.zarr", "cannot be read|no folder"),
    ):
        with pytest.raises(VolumeFileError, match=words):
            read_transform(path)
    at = [[6.0, -20.0], [8.0, -10.0], [9.0, -25.0]]
    with pytest.raises(DeformError, match="over a plane"):
        write_transform(dn.fit_rbf(dn.ControlPoints.from_arrays(at, at)), tmp_path / "e.tfm", GRID)
    with pytest.raises(VolumeFileError, match="ends with one of"):
        write_transform(Identity(3), tmp_path / "e.png", GRID)
    assert not list(tmp_path.glob("e*"))


def test_a_grid_larger_than_its_numbers_is_refused_before_it_is_made(tmp_path: Path) -> None:
    write_transform(_bend(), tmp_path / "a.tfm", GRID)
    write_transform(_bend(), tmp_path / "a.h5", GRID)
    text = (tmp_path / "a.tfm").read_text(encoding="utf-8")
    (tmp_path / "a.tfm").write_text(
        text.replace("FixedParameters: 22 18 14", "FixedParameters: 2200 1800 1400"), encoding="utf-8"
    )
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["TransformGroup/0/TransformFixedParameters"][:3] = [2200, 1800, 1400]
    for name in ("a.tfm", "a.h5"):
        with pytest.raises(VolumeFileError, match=r"2200\.0.* 16632 numbers"):
            read_transform(tmp_path / name)
    dn.write_volume(VOLUME, tmp_path / "v.nhdr")
    header = (tmp_path / "v.nhdr").read_text(encoding="utf-8").replace("data file: ", "data file: ../")
    (tmp_path / "b.nhdr").write_text(header, encoding="utf-8")
    with pytest.raises(VolumeFileError, match="own folder"):
        read_transform(tmp_path / "b.nhdr")


def test_the_command_writes_a_transform_and_its_inverse_and_warp_applies_it(tmp_path: Path) -> None:
    volume, session, out, back, warped = (
        str(tmp_path / name) for name in ("v.nrrd", "s.json", "there.tfm", "forward.nrrd", "w.nrrd")
    )
    dn.write_volume(VOLUME, volume)
    points = dn.ControlPoints.from_arrays([[9.0, -20.0, 20.0]], [[10.0, -19.0, 21.0]])
    document = dn.Deformation.from_space_points(points)
    dn.write_deformation(document, session)
    assert main(["transform", session, volume, out, "--inverse", back]) == 0
    field = document.field(GRID)
    assert np.abs(read_transform(out).displacement(POINTS) - field.displacement(POINTS)).max() < 1e-4
    forth = POINTS + field.displacement(POINTS)
    assert np.abs(forth + read_transform(back).displacement(forth) - POINTS).max() < 0.05
    assert main(["warp", out, volume, warped]) == 0
    assert np.abs(dn.read_volume(warped).values - document.apply(VOLUME).values).max() < 0.05
    assert main(["transform", session, volume, out]) == 2  # it is there
    assert main(["transform", session, volume, str(tmp_path / "new.tfm"), "--inverse", back]) == 2
    assert not (tmp_path / "new.tfm").exists()  # refused before any work
    assert main(["transform", session, volume, str(tmp_path / "w.nii.gz"), "--every", "2", "--inverse"]) == 0
    coarse = read_transform(tmp_path / "w.nii.gz")
    assert isinstance(coarse, DisplacementField)
    assert (coarse.lattice.shape, coarse.lattice.spacing) == ((8, 10, 12), (3.0, 2.0, 4.0))
    assert isinstance(read_transform(tmp_path / "w_forward.nii.gz"), DisplacementField)
    assert main(["warp", str(tmp_path / "w.nii.gz"), volume, warped, "--force"]) == 0
