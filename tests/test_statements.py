"""Statements that README, documentation and program share: one source, or compared here."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image, ImageSequence

import deformnb as dn
from deformnb.rbf.conditioning import LARGEST_SET, MOST_POINTS
from docs import thompson_picture
from readme_links import absolute_links, add_binder, public_urls, read_project, relative_links

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PROJECT = read_project()
PUBLIC: dict[str, str] = PROJECT["tool"]["deformnb"]["public"]
# The other extras are for those who work on the code.
FOR_USERS = {"completion", "formats", "interop", "large", "movie", "notebook"}


def _text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


# -- the README --------------------------------------------------------------------------------------------------------


def test_the_readme_is_short_and_begins_with_the_moving_picture() -> None:
    text = _text("README.md")
    assert len(text.splitlines()) <= 100
    first = re.search(r"!\[[^\]]+\]\((\S+)\)", text)
    assert first is not None
    assert first[1] == "docs/thompson.webp"


def test_the_links_of_the_readme_lead_to_files_and_on_an_index_to_the_repository() -> None:
    text = _text("README.md")
    links = relative_links(text)
    assert len(links) > 15
    assert [link for link in links if not (ROOT / link.partition("#")[0]).is_file()] == []
    public = absolute_links(text, "https://code.example/deformnb", "1.2")
    assert relative_links(public) == []
    assert "](https://code.example/deformnb/raw/v1.2/docs/thompson.webp)" in public
    assert "](https://code.example/deformnb/blob/v1.2/LICENSE)" in public
    assert public.count("](https://doi.org/") == text.count("](https://doi.org/") > 0
    assert absolute_links(text, "", "1.2") == add_binder(text, "", "1.2") == text


@pytest.mark.parametrize(
    ("repository", "place"),
    [("https://github.com/o/d", "gh/o/d"), ("https://code.example/d", "git/https%3A%2F%2Fcode.example%2Fd")],
)
def test_the_readme_of_a_public_home_leads_to_binder(repository: str, place: str) -> None:
    text = _text("README.md")
    added = set(add_binder(text, repository, "1.2").splitlines()) - set(text.splitlines())
    (line,) = added
    assert f"](https://mybinder.org/v2/{place}/v1.2?urlpath=lab/tree/notebooks)" in line
    assert (ROOT / "notebooks").is_dir()
    assert (ROOT / "binder" / "requirements.txt").is_file()


def test_the_public_addresses_have_one_source() -> None:
    assert set(PUBLIC) == {"repository", "documentation", "support", "security", "install"}
    assert "urls" in PROJECT["project"]["dynamic"]
    assert all(url.startswith("https://") for url in public_urls(PUBLIC).values())
    citation = yaml.safe_load(_text("CITATION.cff"))
    assert citation.get("repository-code", "") == PUBLIC["repository"]
    filled = public_urls({"repository": "https://code.example/d", "documentation": "https://d.example"})
    assert filled.keys() == {"Paper", "Repository", "Issues", "Documentation"}
    assert filled["Paper"].endswith(citation["references"][0]["doi"])


LOSS = 12.0  # mean difference of grey values that the compression of the movie makes at most


def test_the_moving_picture_is_what_its_script_makes() -> None:
    assert thompson_picture.PATH.stat().st_size < 600_000
    grids = thompson_picture.place_grids()
    raster = thompson_picture.frame_of(grids)
    goal = thompson_picture.original(grids, raster)
    shares = thompson_picture.shares()
    with Image.open(thompson_picture.PATH) as movie:
        pages = [np.asarray(page.convert("L"), np.float64) for page in ImageSequence.Iterator(movie)]
    assert len(pages) == len(shares)
    for k in (0, thompson_picture.STEPS // 2, thompson_picture.STEPS):
        made = thompson_picture.sheet(thompson_picture.morph(grids, shares[k], raster), goal, shares[k])
        distances = [np.abs(np.asarray(made) - page).mean() for page in pages[: thompson_picture.STEPS + 1]]
        assert np.argmin(distances) == k
        assert distances[k] < LOSS
    assert shares[thompson_picture.STEPS] == 1


# -- lists -------------------------------------------------------------------------------------------------------------


def test_the_features_name_every_command_and_every_package() -> None:
    text = _text("docs/features.md")
    done = subprocess.run([sys.executable, "-m", "deformnb", "--help"], capture_output=True, text=True, check=True)
    commands = re.findall(r"^    (\w+) {2,}\S", done.stdout, re.MULTILINE)
    assert len(commands) > 8
    (row,) = re.findall(r"^\| command line \| (.*) \|$", text, re.MULTILINE)
    assert re.findall(r"`(?:deformnb )?(\w+)`", row) == commands
    packages = {name for name in dir(dn) if isinstance(getattr(dn, name), ModuleType)}
    named = set(re.findall(r"`dn\.(\w+)`", text.partition("| part |")[0]))
    assert packages <= named <= set(dir(dn))


def test_the_extras_of_users_are_listed_once() -> None:
    extras: dict[str, Any] = PROJECT["project"]["optional-dependencies"]
    text = _text("docs/getting_started.md")
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == FOR_USERS <= set(extras)
    named = {}
    for path in (ROOT / "README.md", ROOT / "lessons" / "README.md", *DOCS.glob("*.md"), *DOCS.glob("howto/*.md")):
        for target in re.findall(r"pip install (?:-U )?([^\n`#]*?)(?=\s*[`#\n]|\" )", path.read_text(encoding="utf-8")):
            for one in re.findall(r"(?:\.|\./core|deformnb-core)\[([\w,]+)\]", target):
                named.setdefault(path.name, set()).update(one.split(","))
            is_public = re.search(r"(?<![\w./-])deformnb(?!-core\[)", target) is not None
            assert not is_public or PUBLIC["install"] == "deformnb", f"{path.name}: it is on no index yet: {target}"
    parts = set(re.findall(r"^\|.*\| `pip install \"deformnb-core\[(\w+)\]\"` \|$", text, re.MULTILINE))
    assert PROJECT["tool"]["deformnb"]["core"] == f"deformnb-core[{','.join(sorted(parts))}]"
    assert set().union(*named.values()) <= FOR_USERS | parts
    (first,) = re.findall(r"^```sh\npip install (\S+)", text, re.MULTILINE)[:1]
    assert first == PUBLIC["install"]


def test_the_limits_of_the_readme_are_those_of_the_program_and_its_hosts_those_that_were_tried() -> None:
    text = " ".join(_text("README.md").split("## Limits")[1].partition("\n## ")[0].split())
    assert f"{MOST_POINTS // 1000} 000 control points, {LARGEST_SET} of them in the studio" in text
    tried, untried = re.findall(r"run in (.+?); (.+) \[were not tried\]", text)[0]
    rows = dict(
        re.findall(r"^\| ([^|]+) \| ([^|]+) \|", _text("docs/hosts.md").split("The tests are")[0], re.MULTILINE)
    )
    for names, state in ((tried, "tests in a real browser"), (untried, "emulated")):
        for name in re.split(r", | and ", names):
            found = [value for host, value in rows.items() if re.search(name.replace("Notebook", ".*Notebook"), host)]
            assert {*found} == {state}, name


def test_the_times_of_the_guide_are_those_of_the_table() -> None:
    rows = dict(re.findall(r"^\| ([^|]+) \| ([\d.]+) ms", _text("docs/speed.md"), re.MULTILINE))
    guide = _text("docs/howto/resources.md")
    (replicated,) = re.findall(r"^\| a warp, the map of a picture replicated \| (\d+) ms", guide, re.MULTILINE)
    (general, large) = re.findall(r"^\| a warp by any map \| (\d+) ms \| ([\d.]+) s", guide, re.MULTILINE)[0]
    (fit,) = re.findall(r"^\| 32 points to that map \| (\d+) ms", guide, re.MULTILINE)
    (command,) = re.findall(r"takes ([\d.]+) s for a `.nii.gz`", guide)
    stated = {
        "replicated along z, prepared": float(replicated),
        "general, field given": float(general),
        "general, field given, 512^3": 1000 * float(large),
        "solve and map of 32 points": float(fit),
        "deformnb warp of a carp, nothing cached": 1000 * float(command),
    }
    for row, value in stated.items():
        assert value == pytest.approx(float(rows[row]), abs=max(0.5, 0.02 * value)), row


def test_what_is_said_to_be_measured_nowhere_has_no_figures() -> None:
    """docs/howto/devices.md and docs/speed.md have figures of a GPU; no other page says that there are none."""
    assert re.search(r"NVIDIA H\d00", _text("docs/speed.md"))
    for path in (ROOT / "README.md", *DOCS.glob("*.md"), *DOCS.glob("howto/*.md")):
        for sentence in re.split(r"(?<=[.;|])\s", path.read_text(encoding="utf-8")):
            if re.search(r"nobody has|measured nowhere|was never|not been measured", sentence, re.IGNORECASE):
                assert not re.search(r"GPU|CUDA|NVIDIA", sentence), f"{path.name}: {sentence}"


@pytest.mark.parametrize("heading", re.findall(r"^## (.+)$", _text("docs/coming_from.md"), re.MULTILINE))
def test_the_page_of_other_programs_links_them(heading: str) -> None:
    section = _text("docs/coming_from.md").split(f"## {heading}\n")[1].partition("\n## ")[0]
    for program in re.split(r", | and ", heading):
        if program != "Morphologika":  # its page is gone
            assert re.search(rf"\[{re.escape(program)}\]\(https://", section), program


def test_the_page_of_keys_has_the_words_of_the_list_in_the_editor() -> None:
    table = _text("frontend/src/ui/keys.ts").replace("\\u00b0", "°")
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", _text("docs/howto/keyboard.md"), re.MULTILINE)[2:]
    known = set(re.findall(r'\[\s*"([^"]+)",\s*"([^"]+)"', table))
    assert len(rows) > 20
    assert [row for row in rows if row not in known] == []


OTHER_PROGRAMS = {"napari", "slicer"}  # their pages name buttons of these programs


@pytest.mark.parametrize("page", sorted(DOCS.glob("howto/*.md")), ids=lambda page: page.stem)
def test_what_a_guide_tells_to_press_is_a_visible_text(page: Path) -> None:
    """Labels in italics and sentences in quotation marks begin a key of the table of words, which has all of them."""
    known = [key.lower() for key in json.loads(_text("deformnb/words/de.json"))]
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    labels = re.findall(r"(?<!\*)\*([A-Z][^*\n]+)\*(?!\*)", text) + re.findall(r"\"([A-Z][^\"\n]+)\"", text)
    unknown = {one for one in labels if not any(key.startswith(one.lower().rstrip(".,:")) for key in known)}
    assert (unknown == set()) != (page.stem in OTHER_PROGRAMS), unknown


@pytest.mark.parametrize("page", sorted(DOCS.glob("howto/*.md")), ids=lambda page: page.stem)
def test_the_index_of_the_guides_has_every_page(page: Path) -> None:
    listed = re.findall(r"^(\w+)$", (DOCS / "howto" / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert listed.count(page.stem) == (page.stem != "index")


@pytest.mark.parametrize("word", ["citation", "video"])
def test_the_documentation_has_the_words_that_people_search_for(word: str) -> None:
    pages = [*DOCS.glob("*.md"), *DOCS.glob("howto/*.md")]
    assert any(re.search(rf"\b{word}\b", page.read_text(encoding="utf-8"), re.IGNORECASE) for page in pages)


# -- the article -------------------------------------------------------------------------------------------------------


def _entries() -> dict[str, dict[str, str]]:
    """The fields of the entries of paper.bib by key."""
    found = re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", _text("paper.bib"), re.MULTILINE | re.DOTALL)
    return {key: dict(re.findall(r"^  (\w+) = \{(.*)\},$", fields, re.MULTILINE)) for key, fields in found}


def test_the_article_cites_what_its_bibliography_has() -> None:
    _, head, body = _text("paper.md").split("---\n", 2)
    cited = set(re.findall(r"@(\w+)", body))
    entries = _entries()
    assert cited == set(entries)
    assert len(entries) == _text("paper.bib").count("\n@") + 1
    assert {key for key, fields in entries.items() if not {"author", "title"} <= fields.keys()} == set()
    assert all(re.fullmatch(r"10\.\d{4,}/\S+", fields.get("doi", "10.1000/1")) for fields in entries.values())
    head_fields = yaml.safe_load(head)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= head_fields.keys()
    assert (ROOT / head_fields["bibliography"]).is_file()
    citation = yaml.safe_load(_text("CITATION.cff"))["references"][0]
    assert entries["correa2007volume"]["doi"] == citation["doi"]
    assert entries["correa2007volume"]["pages"] == f"{citation['start']}--{citation['end']}"


def test_the_article_has_the_sections_of_its_journal_and_names_things_that_exist() -> None:
    text = _text("paper.md")
    sections = re.findall(r"^# (.+)$", text, re.MULTILINE)
    assert {"Summary", "Statement of need", "State of the field", "References"} <= set(sections)
    assert 500 < len(text.split()) < 1750
    table = text.split("# State of the field")[1].split("\n# ")[0]
    programs = ["BigWarp", "3D Slicer", "SlicerMorph", "geomorph", "PyGeM", "vedo", "Drishti", "elastix"]
    assert re.findall(r"^\| ([\w ]+) \[@", table, re.MULTILINE) == programs
    done = subprocess.run([sys.executable, "-m", "deformnb", "--help"], capture_output=True, text=True, check=True)
    commands = set(re.findall(r"`deformnb (\w+)`", text))
    assert len(commands) > 2
    assert all(re.search(rf"^    {command} ", done.stdout, re.MULTILINE) for command in commands)
    run = (ROOT / "run").read_text(encoding="utf-8")
    assert all(re.search(rf"^    {task}\)$", run, re.MULTILINE) for task in re.findall(r"`sh run (\w+)`", text))
    assert all((ROOT / path).is_file() for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text))
    assert f"version {PROJECT['project']['version'].rpartition('.')[0]}" in text
