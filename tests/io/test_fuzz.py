"""Random damage to files of every format, in a child process with limits on memory and time.

A reader that crashes, hangs or takes all memory ends the child, and the child's last line names the file.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import SimpleITK
from PIL import Image

from deformnb import Volume
from deformnb.io import FORMATS, write_landmarks, write_series, write_transform, write_volume
from deformnb.io.landmarks.formats import LANDMARK_FORMATS
from deformnb.io.transforms.displacement_images import to_itk_image
from deformnb.io.transforms.formats import TRANSFORM_SUFFIXES
from deformnb.rbf.fields import Affine, DisplacementField, compose
from deformnb.volume import Channels
from deformnb.volume.volume import Grid
from deformnb.warping.points import Landmarks

CASES = 3000 if os.environ.get("HYPOTHESIS_PROFILE") == "nightly" else 150
SECONDS = 20  # for one file: design limit; all but the largest are read in a few milliseconds

# Several suffixes of DICOM name one and the same reader.
SUFFIXES = [suffix for name, entry in FORMATS.items() for suffix in entry.suffixes[: 1 if name == "dicom" else None]]

CHILD = """
import faulthandler, random, resource, signal, sys
from pathlib import Path
import numpy as np
from deformnb import DeformError
from deformnb.chunked import open_volume
from deformnb.io import describe_file, open_series, read_label_names, read_landmarks, read_transform, read_volume
from deformnb.io.files.errors import UNFORESEEN
from deformnb.io.volumes.label_names import read_label_table
from deformnb.io.transforms.formats import describe_transform
for package in ("pydicom", "imagecodecs", "SimpleITK", "h5py", "zarr"):  # outside the limits
    try:
        __import__(package)
    except ImportError:
        pass

folder, names, kind, seed, cases, seconds = Path(sys.argv[1]), sys.argv[2], sys.argv[3], *map(int, sys.argv[4:])
names = names.split("|")  # of valid files, each in a separate folder if there are several

def read_a_volume():
    check(read_volume(folder / name, max_bytes=2**26))

def read_a_series():
    check(list(open_series(folder / name, max_bytes=2**26))[-1][0])

def check(volume):
    describe_file(folder / name)
    assert volume.values.shape == volume.grid.shape and volume.values.nbytes <= 2**27, last
    assert np.isfinite(volume.grid.corners()).all(), last

def read_in_parts():
    source = open_volume(folder / name)
    part = source.read(tuple(slice(0, min(n, 4)) for n in source.shape))
    assert part.shape == tuple(min(n, 4) for n in source.shape) and part.dtype == source.dtype, last

def read_names():
    found = read_label_table(folder / name) or read_label_names(folder / name)
    assert all(isinstance(number, int) and isinstance(text, str) for number, text in found.items()), last

def read_a_transform():
    describe_transform(folder / name)
    field = read_transform(folder / name)
    places = np.zeros((1, field.dim))
    assert field.displacement(places).shape == places.shape, last

def read_some_landmarks():
    assert np.isfinite(read_landmarks(folder / name).points).all(), last

read = {"volume": read_a_volume, "series": read_a_series, "transform": read_a_transform,
        "landmarks": read_some_landmarks, "parts": read_in_parts, "names": read_names}[kind]
faulthandler.enable()
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if sys.platform == "linux" else 0
if used:  # half a gibibyte more than now, of which a volume may take an eighth
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**29, resource.RLIM_INFINITY))
signal.signal(signal.SIGALRM, lambda *_: sys.exit(f"too slow: {last}"))
every = sorted(file for file in folder.rglob("*") if file.is_file() and not file.name.startswith("was."))
whole = {file: file.read_bytes() for file in every}
good = 0

def damaged(data, chance):
    data = bytearray(data)
    if not data:
        return data
    head = len(data) if chance.random() < 0.3 else min(len(data), 600)
    for _ in range(chance.choice((1, 1, 1, 2, 4, 16))):
        at, kind = chance.randrange(head), chance.randrange(5)
        if kind == 0:
            data[at % len(data)] = chance.randrange(256)
        elif kind == 1:
            data[at % len(data)] ^= 1 << chance.randrange(8)
        elif kind == 2:
            data[at:at] = chance.choice((b"9" * 18, b"-", b"nan ", b"\\n", b"\\0", b"1e308 ", b"\\xf0", b"0"))
        elif kind == 3:
            del data[at:at + chance.choice((1, 2, 4, 40))]
        else:
            data[at:at + 4] = chance.choice((b"\\xff" * 4, bytes(4), b"\\x7f\\xff\\xff\\xff", b"\\xff\\xff\\xff\\x7f"))
        if not data:
            break
    return data

for case in range(cases):
    chance = random.Random(seed * 1_000_003 + case)
    name = names[case % len(names)]
    files = [file for file in every if file.is_relative_to((folder / name).parent)]
    target = chance.choice(files)
    last = f"{name} case {case} in {target.name}"
    for file in files:
        file.write_bytes(whole[file])
    target.write_bytes(damaged(whole[target], chance))
    (folder / "was.txt").write_text(last)
    signal.alarm(seconds)
    try:
        read()
    except DeformError as error:
        assert str(error) and len(str(error)) < 2000 and "\\n" not in str(error), last
        assert UNFORESEEN not in str(error), f"{last}: {error}"
    else:
        good += 1
    signal.alarm(0)
print(good)
"""


SERIES = ["series.nrrd", "series.nii", "series.nii.gz", "series.mha", "series.png", "series.webp", "series.tif"]


def seeds(folder: Path, suffix: str) -> str:
    """One valid file (with its companions) in an empty folder; returns its name."""
    if suffix == "series.tif":
        tifffile = pytest.importorskip("tifffile")
        tifffile.imwrite(
            folder / suffix,
            np.arange(720, dtype=np.int16).reshape(2, 4, 3, 5, 6),
            ome=True,
            photometric="minisblack",
            metadata={"axes": "TZCYX"},
        )
        return suffix
    if suffix in SERIES:
        colours = np.arange(360, dtype=np.uint8).reshape(4, 5, 6, 3)[: 1 if suffix.endswith(("png", "webp")) else None]
        moments = [Channels.from_array(colours, kind="rgb")] * (len(colours) // 2 or 1)
        write_series(moments, folder / suffix, len(moments))
        return suffix
    name = f"a{suffix}"
    values = np.arange(120, dtype=np.int16).reshape(4, 5, 6)
    volume = Volume.from_array(values, (1, 2, 3), (4, 5, 6), [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    if suffix in FORMATS["tiff"].suffixes:
        tifffile = pytest.importorskip("tifffile")
        tifffile.imwrite(
            folder / name,
            values,
            compression=None if suffix == ".tif" else "zlib",
            metadata=None,
            photometric="minisblack",
        )
    elif suffix in FORMATS["image"].suffixes:
        Image.fromarray(values[0].astype(np.uint8)).save(folder / name)
    elif suffix in FORMATS["dicom"].suffixes:
        pytest.importorskip("pydicom")
        from dicom_series import write_slice

        write_slice(folder / name, values[0].view(np.uint16), (1, 2, 3))
    else:
        write_volume(volume, folder / name)
    return name


_GRID = Grid((4, 5, 6), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
_NUMBERS = np.random.default_rng(0)


def _composite() -> SimpleITK.Transform:
    """One transform of each family: a versor, Euler angles, a B-spline, a displacement field."""
    spline = SimpleITK.BSplineTransform(3, 3)
    spline.SetTransformDomainMeshSize([2, 1, 1])
    spline.SetParameters(_NUMBERS.normal(size=len(spline.GetParameters())).tolist())
    field = SimpleITK.DisplacementFieldTransform(
        to_itk_image(SimpleITK, DisplacementField(_NUMBERS.normal(size=(*_GRID.shape, 3)), _GRID))
    )
    return SimpleITK.CompositeTransform(
        [
            SimpleITK.ComposeScaleSkewVersor3DTransform(),
            SimpleITK.Euler3DTransform(),
            spline,
            field,
            SimpleITK.AffineTransform(3),
        ]
    )


FORMS = [
    "jpeg.tif",
    "jpeg2000.tif",
    "lerc.tif",
    "png.tif",
    "jpegxl.tif",
    "webp.tif",
    "zstd.tif",
    "lzma.tif",
    "lzw.tif",
    "bits.tif",
    "planes.tif",
    "lossless.dcm",
    "jpegls.dcm",
    "frames.dcm",
    "list.nhdr",
    "pattern.mhd",
    "text.nrrd",
    "hex.nrrd",
    "axes.zarr",
]
"""Files in other packings and forms than those that are written here."""


def form_seeds(folder: Path, name: str) -> str:
    """One valid file of a form in an empty folder; returns its name."""
    import imagecodecs
    import tifffile

    values, kind = np.arange(960, dtype=np.uint8).reshape(2, 20, 24), name.partition(".")[0]
    colours = np.stack([values] * 3, axis=-1)
    if name in ("bits.tif", "planes.tif"):
        options = {"bitspersample": 4} if kind == "bits" else {"planarconfig": "separate", "compression": "zlib"}
        tifffile.imwrite(
            folder / name,
            values % 16 if kind == "bits" else np.moveaxis(colours, -1, 1),
            metadata=None,
            photometric="minisblack" if kind == "bits" else "rgb",
            **options,
        )
    elif name.endswith(".tif"):
        is_colour = kind in ("jpeg", "webp")
        tifffile.imwrite(
            folder / name,
            colours if is_colour else values,
            compression=kind,
            metadata=None,
            photometric="rgb" if is_colour else "minisblack",
        )
    elif name.endswith(".dcm"):
        pydicom = pytest.importorskip("pydicom")
        from dicom_series import write_slice

        deep = values[0].astype(np.uint16) * 11
        coded = {
            "lossless": ("70", lambda: imagecodecs.jpeg8_encode(deep, lossless=True)),
            "jpegls": ("80", lambda: imagecodecs.jpegls_encode(deep)),
            "frames": ("90", lambda: imagecodecs.jpeg2k_encode(deep, reversible=True, level=0)),
        }
        syntax, encode = coded[kind]
        count = 3 if kind == "frames" else 1
        write_slice(
            folder / name,
            deep,
            (1, 2, 3),
            syntax=f"1.2.840.10008.1.2.4.{syntax}",
            NumberOfFrames=count,
            SliceThickness=2,
            raw=pydicom.encaps.encapsulate([bytes(encode())] * count),
        )
    elif name.endswith(".zarr"):
        zarr = pytest.importorskip("zarr")
        axes = [{"name": axis, "type": "channel" if axis == "c" else "space"} for axis in "xcyz"]
        scales = [{"type": "scale", "scale": [1, 1, 2, 3]}]
        about = {"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scales}]}
        group = zarr.create_group(
            str(folder / name), zarr_format=3, attributes={"ome": {"version": "0.5", "multiscales": [about]}}
        )
        group.create_array("0", shape=(6, 2, 4, 5), chunks=(3, 1, 2, 5), shards=(6, 1, 4, 5), dtype="u1")[...] = 7
    else:
        head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 20 2\n"
        named = {
            "list": "encoding: raw\ndata file: LIST\ns0.raw\ns1.raw\n",
            "text": "encoding: ascii\n\n",
            "hex": "encoding: hex\n\n",
            "pattern": "ObjectType = Image\nNDims = 3\nDimSize = 24 20 2\n"
            "ElementType = MET_UCHAR\nElementDataFile = s%d.raw 0 1 1\n",
        }[kind]
        data = {"text": " ".join(map(str, values.ravel())), "hex": values.tobytes().hex()}.get(kind, "")
        (folder / name).write_text(("" if kind == "pattern" else head) + named + data, encoding="utf-8")
        for k in range(2 if kind in ("list", "pattern") else 0):
            (folder / f"s{k}.raw").write_bytes(values[k].tobytes())
    return name


def transform_seeds(folder: Path, kind: str) -> str:
    """A transform in an empty folder; returns its name."""
    suffix = kind[kind.index(".") :]
    name, field = f"a{suffix}", DisplacementField(_NUMBERS.normal(size=(*_GRID.shape, 3)), _GRID)
    if kind.startswith("itk"):
        SimpleITK.WriteTransform(_composite(), str(folder / name))
    elif suffix == ".mat":
        scipy.io.savemat(
            folder / name,
            {"AffineTransform_double_3_3": np.arange(12.0)[:, None], "fixed": np.zeros((3, 1))},
            format="4",
        )
    elif suffix == ".txt":
        SimpleITK.WriteImage(to_itk_image(SimpleITK, field), str(folder / "field.mha"))
        (folder / "first.txt").write_text(
            '(Transform "DeformationFieldTransform")\n(DeformationFieldFileName '
            '"field.mha")\n(FixedImageDimension 3)\n'
            '(InitialTransformParameterFileName "NoInitialTransform")\n',
            encoding="utf-8",
        )
        (folder / name).write_text(
            '(Transform "BSplineTransform")\n(NumberOfParameters 192)\n(TransformParameters '
            f"{' '.join(map(repr, _NUMBERS.normal(size=192).tolist()))})\n(GridSize 4 4 4)\n"
            "(GridOrigin 0 0 0)\n(GridSpacing 9 9 9)\n(GridDirection 1 0 0 0 1 0 0 0 1)\n"
            "(BSplineTransformSplineOrder 3)\n(FixedImageDimension 3)\n"
            '(InitialTransformParameterFileName "first.txt")\n',
            encoding="utf-8",
        )
    elif suffix in (".nhdr", ".mhd"):  # read with the file next to them, and written in one
        SimpleITK.WriteImage(to_itk_image(SimpleITK, field), str(folder / name))
    else:
        write_transform(compose(field, Affine(np.eye(3), np.ones(3))), folder / name, _GRID)
    return name


TRANSFORMS = [*TRANSFORM_SUFFIXES, *(f"itk{suffix}" for suffix in (".tfm", ".h5"))]


PARTS = ["a.h5", "a.tif", "a.npy", "a.zarr", "two.zarr"]


def part_seeds(folder: Path, name: str) -> str:
    """A volume of several chunks in an empty folder; returns its name."""
    values = np.arange(720, dtype=np.int16).reshape(8, 9, 10)
    if name == "a.h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / name, "w") as file:
            file.create_dataset("scan", data=values, chunks=(4, 4, 4), compression="gzip")
            file["scan"].attrs["element_size_um"] = (2.0, 1.0, 1.0)
    elif name == "a.tif":
        tifffile = pytest.importorskip("tifffile")
        tifffile.imwrite(folder / name, values, compression="zlib", photometric="minisblack", metadata=None)
    elif name == "two.zarr":
        zarr = pytest.importorskip("zarr")
        array = zarr.create_array(
            str(folder / name), shape=values.shape, chunks=(4, 4, 4), dtype=values.dtype, zarr_format=2
        )
        array[...] = values
    else:
        write_volume(Volume.from_array(values, (1, 2, 3)), folder / name)
    return name


NAMES = {
    "a.csv": "label,name\n1,femur\n2,tibia\n",
    "a.tsv": "value\tstructure\n7\taorta\n",
    "a.ctbl": "# colours\n1 femur 10 20 30 255\n2 tibia 40 50 60 255\n",
    "a.label": '1 255 0 0 1 1 1 "femur"\n2 0 255 0 1 1 1 "tibia"\n',
    "a.seg.nrrd": "",
}


def name_seeds(folder: Path, name: str) -> str:
    """A table of the names of labels, or a segmentation of 3D Slicer that names them; returns its name."""
    (folder / name).write_text(NAMES[name], encoding="utf-8")
    if not NAMES[name]:
        segments = "".join(
            f"Segment{k}_{key}:={value}\n"
            for k in range(2)
            for key, value in (
                ("ID", f"s{k}"),
                ("Name", f"bone {k}"),
                ("LabelValue", k + 1),
                ("Layer", 0),
                ("Extent", "0 1 0 1 0 1"),
            )
        )
        (folder / name).write_bytes(
            f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n{segments}\n".encode()
            + bytes([0, 1, 2, 0, 1, 2, 0, 1])
        )
    return name


def landmark_seeds(folder: Path, suffix: str) -> str:
    """Five landmarks, with fixed places where the format has room for them; returns the name of their file."""
    places = np.random.default_rng(0).normal(size=(2, 5, 3)) * 100
    write_landmarks(Landmarks(places[0], tuple("abcde"), fixed=places[1]), folder / f"a{suffix}")
    return f"a{suffix}"


def _damage(folder: Path, name: str, kind: str, seed: int, *, may_be_read: bool = False) -> None:
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-c",
        CHILD,
        str(folder),
        name,
        kind,
        str(seed),
        str(CASES),
        str(SECONDS),
    ]
    child = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    noted = folder / "was.txt"
    last = noted.read_text(encoding="utf-8") if noted.exists() else "before the first case"
    assert child.returncode == 0, f"{last}:\n{child.stderr[-3000:]}"
    assert may_be_read or int(child.stdout) < CASES  # some damage was noticed


ONLY_POSIX = pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")


@pytest.mark.sampled(3)
@ONLY_POSIX
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_random_damage_ends_in_a_volume_or_one_sentence(suffix: str, tmp_path: Path) -> None:
    _damage(tmp_path, seeds(tmp_path, suffix), "volume", SUFFIXES.index(suffix))


@pytest.mark.sampled(7)
@ONLY_POSIX
@pytest.mark.parametrize("name", FORMS)
def test_random_damage_to_other_forms_ends_in_a_series_or_one_sentence(name: str, tmp_path: Path) -> None:
    _damage(tmp_path, form_seeds(tmp_path, name), "series", FORMS.index(name))


@pytest.mark.nightly
@ONLY_POSIX
@pytest.mark.parametrize("name", SERIES)
def test_random_damage_ends_in_a_series_or_one_sentence(name: str, tmp_path: Path) -> None:
    _damage(tmp_path, seeds(tmp_path, name), "series", len(SUFFIXES) + SERIES.index(name))


@ONLY_POSIX
def test_random_damage_to_each_kind_of_transform_in_turn(tmp_path: Path) -> None:
    names = []
    for kind in TRANSFORMS:
        (tmp_path / kind).mkdir()
        names.append(f"{kind}/{transform_seeds(tmp_path / kind, kind)}")
    _damage(tmp_path, "|".join(names), "transform", 3)


@pytest.mark.nightly
@ONLY_POSIX
@pytest.mark.parametrize("kind", TRANSFORMS)
def test_random_damage_ends_in_a_transform_or_one_sentence(kind: str, tmp_path: Path) -> None:
    _damage(tmp_path, transform_seeds(tmp_path, kind), "transform", TRANSFORMS.index(kind))


@pytest.mark.nightly
@ONLY_POSIX
@pytest.mark.parametrize("kind", LANDMARK_FORMATS)
def test_random_damage_ends_in_landmarks_or_one_sentence(kind: str, tmp_path: Path) -> None:
    _damage(tmp_path, landmark_seeds(tmp_path, LANDMARK_FORMATS[kind].suffix), "landmarks", len(kind))


@pytest.mark.nightly
@ONLY_POSIX
@pytest.mark.parametrize("name", PARTS)
def test_random_damage_ends_in_parts_or_one_sentence(name: str, tmp_path: Path) -> None:
    _damage(tmp_path, part_seeds(tmp_path, name), "parts", PARTS.index(name))


@pytest.mark.nightly
@ONLY_POSIX
@pytest.mark.parametrize("name", NAMES)
def test_random_damage_ends_in_names_or_none(name: str, tmp_path: Path) -> None:
    _damage(tmp_path, name_seeds(tmp_path, name), "names", len(name), may_be_read=True)


def test_random_damage_in_a_folder_of_slices(tmp_path: Path) -> None:
    pytest.importorskip("pydicom")
    from dicom_series import NORMAL, VOXELS, write_slice

    from deformnb import DeformError
    from deformnb.io import read_volume

    for k, pixels in enumerate(VOXELS[:3]):
        write_slice(tmp_path / f"{k}.dcm", pixels, NORMAL * k)
    whole = (tmp_path / "1.dcm").read_bytes()
    chance = np.random.default_rng(0)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for at in chance.integers(132, len(data), 3):
            data[at] = int(chance.integers(256))
        (tmp_path / "1.dcm").write_bytes(bytes(data))
        try:
            read_volume(tmp_path)
        except DeformError:
            refused += 1
    assert 0 < refused < 60
