"""The documentation: its pages build without a warning, need nothing from elsewhere, and their Python runs."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from PIL import Image

from deformnb.widgets.embedded_page import EmbeddedPage
from docs.notebook_pages import separate_studios
from docs.pictures import READERS_FILE, page_parts, run_page, write_card, write_picture

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SINGLE = ("getting_started", "coming_from", "lessons", "how_it_works", "reliability")
PAGES = [*(DOCS / f"{name}.md" for name in SINGLE), *sorted(DOCS.glob("howto/*.md"))]
WITH_CODE = [page for page in PAGES if any(kind == "python" for kind, _, _ in page_parts(page.read_text("utf-8")))]
WITHOUT = {DOCS / "how_it_works.md", DOCS / "reliability.md"}  # one has the figures of the paper, the other its tables
MOST_BYTES = 150_000  # of a picture: a page with three opens at once on a phone


@pytest.mark.sampled(5)
@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.stem)
def test_the_python_of_a_page_runs_and_makes_its_pictures(page: Path, tmp_path: Path) -> None:
    text = page.read_text("utf-8")
    assert re.search(r"^import deformnb as dn$|^from deformnb", text, re.MULTILINE)
    (tmp_path / "run").mkdir()
    shown = run_page(text, tmp_path / "run")
    assert len(shown) == sum(kind == "picture" for kind, _, _ in page_parts(text))
    for number, one in enumerate(shown):
        file = write_picture(one, tmp_path / "pictures" / str(number))
        assert file.stat().st_size < MOST_BYTES
        with Image.open(file) as picture:
            assert 480 <= picture.width <= 1280
            assert np.asarray(picture.convert("L")).std() > 4, "nothing is seen in it"


PICTURE = """
Text, and a file of the reader's:

```python
raise ValueError("scan.nii.gz is not there")
```

```python
import matplotlib.pyplot as plt
from PIL import Image

a = Image.new("RGB", (20, 10))
a
```

```{picture} A black picture
A caption.
```

```python
plt.plot([0, 1]);
```

```{picture} A line
```

```python
a.save("b.png")
```

```{picture} The same again
:file: b.png
```
"""


def test_pictures_are_what_the_python_above_them_has_made(tmp_path: Path) -> None:
    assert [kind for kind, _, _ in page_parts(PICTURE)] == ["python", "python", *["picture", "python"] * 2, "picture"]
    assert READERS_FILE in page_parts(PICTURE)[0][2]
    image, figure, file = run_page(PICTURE, tmp_path)
    assert image.size == (20, 10)
    assert [line.get_ydata().tolist() for line in figure.axes[0].lines] == [[0, 1]]
    assert file == tmp_path / "b.png"
    written = [write_picture(one, tmp_path / f"p{k}").name for k, one in enumerate((image, figure, file))]
    assert written == ["p0.webp", "p1.webp", "p2.png"]
    with pytest.raises(ValueError, match="'A black picture' ends with no picture, but with None"):
        run_page(PICTURE.replace("\na\n", "\n"), tmp_path)


def test_a_card_shows_the_whole_picture_on_its_own_ground(tmp_path: Path) -> None:
    for size, seen in (((800, 200), (480, 120)), ((100, 100), (100, 100)), ((300, 900), (120, 360))):
        picture = Image.new("RGB", size, "red")
        picture.paste("blue", (2, 2, size[0] - 2, size[1] - 2))
        picture.save(tmp_path / "picture.png")
        write_card(tmp_path / "picture.png", tmp_path / "card.webp")
        with Image.open(tmp_path / "card.webp") as card:
            assert card.size == (480, 360)
            red, _, blue = np.moveaxis(np.asarray(card, dtype=int), -1, 0)
            assert red[0, 0] > 200 > 60 > blue[0, 0]
            inside = np.argwhere(blue > red)
            assert np.abs(np.ptp(inside, axis=0)[::-1] - np.array(seen)).max() <= 8


def test_pages_of_studios_become_files_that_are_loaded_when_they_are_seen(tmp_path: Path) -> None:
    frame = EmbeddedPage('<p title="a">1 &lt; 2</p>', "A carp")
    body = f"<p>before</p>{frame.markup()}<p>between</p>{frame.markup()}"
    found = separate_studios(body, tmp_path / "studios", "../_studios/")
    (file,) = (tmp_path / "studios").iterdir()  # the same page once
    assert file.read_text("utf-8") == frame.page
    assert found == body.replace(frame.markup(), replace(frame, source=f"../_studios/{file.name}").markup())
    output = replace(frame, still=b"png").output()
    assert "<img" in output
    assert "<img" not in separate_studios(output, tmp_path / "studios", "")
    assert separate_studios("<p>srcdoc</p>", tmp_path / "none", "") == "<p>srcdoc</p>"


@pytest.mark.parametrize("page", [*sorted({*PAGES} - WITHOUT), DOCS / "pipelines.md"], ids=lambda page: page.stem)
def test_each_page_shows_what_it_is_about(page: Path) -> None:
    text = page.read_text("utf-8")
    made = [argument for kind, argument, _ in page_parts(text) if kind == "picture"]
    made += re.findall(r"```{cards}\n(\S+)", text)
    assert made, "no picture is made by the Python of this page"


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.stem)
def test_pictures_have_a_text_for_those_who_do_not_see_them(page: Path) -> None:
    text = page.read_text("utf-8")
    texts = [argument for kind, argument, _ in page_parts(text) if kind == "picture"]
    texts += re.findall(r"!\[([^\]]*)\]\(", text) + re.findall(r":img-alt:(.*)", text)
    assert [one for one in texts if len(one.split()) < 3] == []
    assert text.count(":img-top:") == text.count(":img-alt:")


def dead_links(folder: Path) -> set[tuple[str, str]]:
    """Links within the documentation that lead to no file, or to no place in it."""
    pages = {page: page.read_text("utf-8") for page in folder.rglob("*.html")}
    places = {page: set(re.findall(r"\s(?:id|name)=\"([^\"]+)\"", text)) for page, text in pages.items()}
    dead = set()
    for page, text in pages.items():
        for link in re.findall(r"<a[^>]*\shref=\"([^\"]*)\"", text):
            url = urlsplit(html.unescape(link))
            if url.scheme or url.netloc or "_modules" in page.parts:
                continue  # Sphinx links its listings of sources to those of Python, which it does not have
            target = (page.parent / unquote(url.path)).resolve() if url.path else page
            known = places.get(target, set())
            if not target.exists() or (url.fragment and known and unquote(url.fragment) not in known):
                dead.add((page.relative_to(folder).as_posix(), link))
    return dead


def test_a_link_to_nowhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<a href="b.html">b</a> <a id="here" href="#here">a</a> <a href="#gone">a</a>', encoding="utf-8"
    )
    assert dead_links(tmp_path) == {("a.html", "b.html"), ("a.html", "#gone")}


def unnamed_arrows(text: str) -> list[str]:
    """The elements of a page that open and close others, and have neither text nor a name."""
    found = re.findall(r"<summary([^>]*)>(.*?)</summary>", text, re.DOTALL)
    return [inner for given, inner in found if "aria-label" not in given and not re.sub(r"<[^>]*>|\s", "", inner)]


def test_the_arrows_of_the_navigation_are_named_after_their_pages(tmp_path: Path) -> None:
    if find_spec("pydata_sphinx_theme") is None:
        pytest.skip("the extra docs is not installed")
    (tmp_path / "conf.py").write_text(
        "import runpy\n"
        'html_theme, project = "pydata_sphinx_theme", "a"\n'
        f"real = runpy.run_path({str(DOCS / 'conf.py')!r})['_name_navigation']\n"
        'def setup(app): app.connect("html-page-context", real, priority=900)\n',
        encoding="utf-8",
    )
    for name, title, below in (("index", "All", "api"), ("api", "API", "maps"), ("maps", "Maps & *grids*", "warp")):
        text = f"{title}\n{'=' * len(title)}\n\n.. toctree::\n\n   {below}\n"
        (tmp_path / f"{name}.rst").write_text(text, encoding="utf-8")
    (tmp_path / "warp.rst").write_text("Warp\n====\n", encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "--quiet", str(tmp_path), str(tmp_path / "html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    text = (tmp_path / "html" / "api.html").read_text("utf-8")
    assert '<summary aria-label="Pages below Maps &amp; grids">' in text
    assert unnamed_arrows(text) == []


@pytest.mark.nightly
def test_the_pages_are_built_and_fetch_nothing_from_elsewhere(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            "--builder",
            "html",
            "--fail-on-warning",
            "--keep-going",
            "--quiet",
            "--doctree-dir",
            str(tmp_path / "trees"),
            str(DOCS),
            str(tmp_path / "html"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    pages = {
        page.relative_to(tmp_path / "html").as_posix(): page.read_text("utf-8")
        for page in (tmp_path / "html").rglob("*.html")
    }
    assert {
        "index.html",
        "carp.html",
        "thompson.html",
        "howto/cuts.html",
        "notebooks/03_darcy_thompson_carp.html",
        "api/generated/deformnb.rbf.fit_rbf.html",
    } <= pages.keys()
    loaded = {
        (name, url)
        for name, text in pages.items()
        for url in re.findall(r"<(?:script|img|iframe|source)[^>]*\ssrc=\"(\w+:[^\"]*)\"", text)
        + re.findall(r"<link[^>]*rel=\"(?:stylesheet|preload|icon)\"[^>]*href=\"(\w+:[^\"]*)\"", text)
    }
    assert {(name, url) for name, url in loaded if not url.startswith("data:")} == set()
    assert "<math" in pages["how_it_works.html"]
    assert {name for name, text in pages.items() if unnamed_arrows(text)} == set()
    assert dead_links(tmp_path / "html") == set()
    notebooks = {name: text for name, text in pages.items() if name.startswith("notebooks/")}
    assert [name for name, text in notebooks.items() if "srcdoc=" in text or "Not yet." in text] == []
    studios = re.findall(r'<iframe class="dnb-embedded"[^>]* src="([^"]*)"', "".join(notebooks.values()))
    assert len(studios) > 4
    assert pages["gallery.html"].count("_card.webp") == len([name for name in notebooks if "lessons/" not in name])
    lessons = [text for name, text in notebooks.items() if "lessons/" in name]
    assert [text for text in lessons if "<img" not in text and "<svg" not in text] == []
    search = (tmp_path / "html" / "searchindex.js").read_text("utf-8")
    assert all(f'"{stem}":' in search for stem in ("citat", "video"))
    assert "\\begin" not in pages["how_it_works.html"]
