"""Free memory: the limits of containers and of all groups around the process count."""

from __future__ import annotations

from pathlib import Path

import pytest

from deformnb.io import available_memory
from deformnb.io.files import memory

V2 = ("memory.max", "memory.current", "inactive_file")
V1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
NO_LIMIT = {V2: "max", V1: "9223372036854771712"}


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with 10 MB free and no groups; more is written into its folder."""
    (tmp_path / "proc" / "self").mkdir(parents=True)
    monkeypatch.setattr(memory, "_system_memory", lambda: 10_000_000)
    monkeypatch.setattr(memory, "Path", lambda path: tmp_path if path == "/" else Path(path))
    return tmp_path


def tell(machine: Path, groups: str, mounts: str) -> None:
    (machine / "proc/self/cgroup").write_text(groups, encoding="utf-8")
    (machine / "proc/self/mountinfo").write_text(mounts, encoding="utf-8")


def group(
    machine: Path, folder: str, files: tuple[str, str, str], limit: int | None, usage: int = 0, cache: int = 0
) -> None:
    place = machine / folder
    place.mkdir(parents=True, exist_ok=True)
    (place / files[0]).write_text(NO_LIMIT[files] if limit is None else f"{limit}\n", encoding="utf-8")
    (place / files[1]).write_text(f"{usage}\n", encoding="utf-8")
    (place / "memory.stat").write_text(f"anon 5\n{files[2]} {cache}\n", encoding="utf-8")


MOUNT_V2 = "31 23 0:28 / /sys/fs/cgroup rw,nosuid shared:9 - cgroup2 cgroup2 rw,nsdelegate\n"
MOUNT_V1 = (
    "35 31 0:32 / /sys/fs/cgroup/cpu rw,relatime - cgroup cgroup rw,cpu\n"
    "36 31 0:33 / /sys/fs/cgroup/memory rw,relatime - cgroup cgroup rw,memory\n"
)


@pytest.mark.parametrize(
    ("files", "groups", "mounts", "top"),
    [
        (V2, "0::/user.slice/job\n", MOUNT_V2, "sys/fs/cgroup"),
        (V1, "5:cpu:/other\n4:memory:/user.slice/job\n", MOUNT_V1, "sys/fs/cgroup/memory"),
        (V1, "4:cpu,memory:/user.slice/job\n0::/\n", MOUNT_V1 + MOUNT_V2, "sys/fs/cgroup/memory"),
        (V2, "0::/docker/abc/user.slice/job\n", MOUNT_V2.replace(" / ", " /docker/abc "), "sys/fs/cgroup"),
        (V2, "0::/user.slice/job\n", MOUNT_V2.replace("/sys/fs/cgroup", r"/my\040groups"), "my groups"),
    ],
)
def test_the_least_room_of_all_groups_around_the_process_counts(
    files: tuple[str, str, str], groups: str, mounts: str, top: str, machine: Path
) -> None:
    tell(machine, groups, mounts)
    group(machine, f"{top}/user.slice/job", files, None)
    group(machine, f"{top}/user.slice", files, None, 50)
    group(machine, top, files, None)
    assert available_memory() == 10_000_000
    group(machine, f"{top}/user.slice/job", files, 1_000_000, 400_000, 100_000)
    assert available_memory() == 700_000
    group(machine, f"{top}/user.slice", files, 900_000, 500_000)
    assert available_memory() == 400_000  # others have taken from the group around
    group(machine, top, files, 800_000, 700_000)
    assert available_memory() == 100_000
    group(machine, top, files, 800_000, 900_000)
    assert available_memory() == 0
    group(machine, f"{top}/user.slice/neighbour", files, 10, 10)
    group(machine, top, files, None)
    assert available_memory() == 400_000


@pytest.mark.parametrize("groups", ["0::/../../elsewhere\n", "0::/elsewhere\n", "0::/\n"])
def test_a_group_that_is_not_seen_from_here_leaves_the_limit_of_the_part_that_is(groups: str, machine: Path) -> None:
    tell(machine, groups, MOUNT_V2.replace(" / ", " /docker/abc "))
    group(machine, "sys/fs/cgroup", V2, 1_000_000, 400_000)
    assert available_memory() == 600_000


@pytest.mark.parametrize(
    ("groups", "mounts"),
    [
        ("", ""),
        ("0::/a\n", ""),
        ("", MOUNT_V2),
        ("4:cpu:/a\n", MOUNT_V1),
        ("0::/a\n", "1 2 0:3 / / rw - ext4 /dev/sda rw\n"),
    ],
)
def test_without_groups_the_memory_of_the_machine_counts(groups: str, mounts: str, machine: Path) -> None:
    assert available_memory() == 10_000_000
    tell(machine, groups, mounts)
    group(machine, "sys/fs/cgroup/a", V2, None)
    (machine / "sys/fs/cgroup/a/memory.stat").unlink()
    assert available_memory() == 10_000_000
