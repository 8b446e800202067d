"""The files that are written from the package: none is stale, and the front end repeats no constant of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.generate import CONSTANTS, NAMES, files
from deformnb.widgets.messages.schema import CHANNELS

GENERATED = SOURCES / "generated.ts"
ASSIGNMENT = re.compile(r"\b([A-Z][A-Z0-9_]{2,})(?:: [^=,;]+)? = ([^,;]+?)(?:,\n|;)")


@pytest.mark.parametrize("path", list(files()), ids=lambda path: path.name)
def test_no_generated_file_is_stale(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == files()[path], "run: python -m deformnb.widgets.generate"


def test_the_front_end_has_the_names_and_values_of_the_package() -> None:
    text = GENERATED.read_text(encoding="utf-8")
    for module, names in CONSTANTS.values():
        for name in names:
            (written,) = re.findall(rf"^export const {name}(?:: [^=]+)? = (.*?)(?: as const)?;$", text, re.M)
            assert json.loads(written) == json.loads(json.dumps(getattr(module, name))), name


def test_no_two_constants_share_a_name() -> None:
    names = [name for _, constants in CONSTANTS.values() for name in constants]
    assert len(names + list(NAMES)) == len({*names, *NAMES})


# Numbers of the front end that share a name with a constant of the package and mean something else.
OTHERS = {
    ("ui/orientation_cube.ts", "FLAT"),  # a side of the cube that is seen from in front
    ("webgl/voxel_textures.ts", "FINEST"),  # a power of two
    ("inputs/value_axes.ts", "FINEST"),  # a step of the axis
}


def test_the_front_end_types_no_constant_again() -> None:
    shared = {*NAMES, *(name for _, constants in CONSTANTS.values() for name in constants)}
    found = []
    for path in SOURCES.rglob("*.ts"):
        if path != GENERATED:
            for name, value in ASSIGNMENT.findall(path.read_text(encoding="utf-8")):
                where = path.relative_to(SOURCES).as_posix()
                if name in shared and (where, name) not in OTHERS:
                    found.append(f"{where}: {name} = {value}")
    assert found == []


def test_front_ends_send_what_the_channels_hold() -> None:
    sent = set()
    for path in SOURCES.rglob("*.ts"):
        # A page without Python sends what Python would; the application's own procedures are no messages of widgets.
        if path.relative_to(SOURCES).parts[0] != "standalone.ts":
            text = path.read_text(encoding="utf-8")
            sent |= set(re.findall(r'(?:(?:send|post)\((?:"\w+", )?|: \w+ = )\{[^}]*?\btype: "(\w+)"', text))
    assert sent | {"size"} == {
        message.tag() for channel in CHANNELS for message in channel.incoming_records
    }  # by a variable


def test_python_sends_what_the_channels_hold() -> None:
    folder = Path(SOURCES.parents[1] / "deformnb" / "widgets")
    text = "\n".join(path.read_text(encoding="utf-8") for path in folder.rglob("*.py"))
    sent = set(re.findall(r"post\(\s*(\w+)\(", text)) | set(re.findall(r"(?:message|answer) = (\w+)\(", text))
    sent |= set(re.findall(r"isinstance\(message, (\w+)\):.*\n\s+self\.post\(message\)", text))  # to all windows
    sent |= set(re.findall(r"(?:return|yield) (FrameSent|SurfaceFound|Fragment)\(", text))
    assert {message.__name__ for channel in CHANNELS for message in channel.to_front_end} <= sent
    assert not re.findall(r"(?:(?<!_)send\(|post\()\{", text)  # a message without a record
