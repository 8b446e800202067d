"""Checks that a tag can be released, and prints the notes of the release: its part of the changelog.

``python .ci/check_release.py v0.1.0`` ends with a sentence where a distribution has another version, the changelog has
no date, or an address of the public home is missing.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
import readme_links  # noqa: E402


def check(tag: str) -> str:
    """The notes of a release, or the first reason not to make it.

    Parameters
    ----------
    tag : such as "v0.1.0".
    """
    table, version = readme_links.read_project()["tool"]["deformnb"], tag.removeprefix("v")
    for folder in table["distributions"]:
        found = readme_links.read_project(ROOT / folder)["project"]["version"]
        if found != version:
            sys.exit(f"{folder}/pyproject.toml has the version {found}, and the tag is {tag}")
    if f"\nversion: {version}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        sys.exit(f"CITATION.cff has another version than {version}")
    if empty := [name for name, address in table["public"].items() if not address]:
        sys.exit(f"tool.deformnb.public in pyproject.toml has no address for {', '.join(empty)}")
    if table["public"]["install"] != "deformnb":
        sys.exit("tool.deformnb.public in pyproject.toml: released, pip installs deformnb by its name")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    notes = re.search(
        rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$\n(.*?)(?=^## |\Z)", changes, re.MULTILINE | re.DOTALL
    )
    if notes is None:
        sys.exit(f"CHANGELOG.md has no heading of {version} with its date")
    return notes[1].strip()


if __name__ == "__main__":
    print(check(sys.argv[1]))
