"""Sphinx: ``sh run docs`` builds the pages in ``docs/_build/html``. Nothing in them is fetched from elsewhere."""

from __future__ import annotations

import importlib
import os
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import latex2mathml.converter
import numpy as np
import yaml
from docutils import nodes

import deformnb as dn
import deformnb_lessons
from deformnb.datasets import DATASETS, PHANTOMS
from deformnb.widgets.embedded_page import EMBED_VARIABLE
from deformnb.words import LANGUAGES
from deformnb_lessons import LESSONS, write_answers, write_lesson_page, write_worksheet

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.resolve().parent))  # for docs.pictures

project = "deformnb"
author = copyright = "The deformnb developers"  # noqa: A001 (Sphinx calls it so)
version = release = dn.__version__

extensions = [
    "docs.notebook_pages",
    "docs.pictures",
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build", "_pictures", "api/_citation.md", "api/_datasets.md"]

# -- pages in Markdown, and the notebooks ------------------------------------------------------------------------------
myst_enable_extensions = ["colon_fence", "dollarmath", "fieldlist", "substitution"]
PUBLIC_HOME = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["deformnb"]["public"]
myst_substitutions = {  # where users ask, and until there is an address the place in words
    "support": PUBLIC_HOME["support"] or "under *Issues* on the page of the repository",
    "security": PUBLIC_HOME["security"] or "*Security*, *Report a vulnerability* on that page",
}
myst_heading_anchors = 3
suppress_warnings = ["myst.header", "myst.xref_missing"]  # parts of the README are included, and it links to files
nb_execution_mode = "cache"  # again only where the code of a notebook has changed: remove it when the package has
nb_execution_raise_on_error = True
nb_execution_in_temp = True  # each time in an empty folder
os.environ[EMBED_VARIABLE] = "1"  # for the kernels: a studio is saved as its page
os.environ["IPYTHONDIR"] = str(HERE / "_build" / ".ipython")  # without the start-up files of whoever builds
nb_execution_timeout = 600
nb_execution_cache_path = str(HERE / "_build" / ".jupyter_cache")  # of all builds, those of tests too
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}  # by default a script of a server; widgets are shown by their picture

# -- the reference ----------------------------------------------------------------------------------------------------
autosummary_generate = True
autodoc_typehints = "none"  # the signature has them in full, the table of parameters explains them
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

# -- appearance -------------------------------------------------------------------------------------------------------
templates_path = ["_templates"]
html_theme = "pydata_sphinx_theme"
html_title = "deformnb"
html_baseurl = PUBLIC_HOME["documentation"]  # each page names the address at which it is to be found
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_made"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_theme_options = {
    "show_nav_level": 1,
    "navigation_depth": 2,
    "header_links_before_dropdown": 6,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "search_as_you_type": True,
    "show_version_warning_banner": False,
}
html_sidebars = {
    name: [] for name in ("index", "getting_started", "features", "how_it_works", "coming_from")
}  # they have no pages below


# -- equations: MathML, which browsers draw and screen readers read without a script -----------------------------------
def _mathml(display: str) -> Any:
    def visit(translator: Any, node: nodes.Element) -> None:
        translator.body.append(latex2mathml.converter.convert(node.astext(), display=display))
        raise nodes.SkipNode

    return visit, None


# -- generated at each build -------------------------------------------------------------------------------------------
def _make_live_pages() -> None:
    """The studio of the front page, exported of a procedural carp, and the page that opens files."""
    target = HERE / "_made" / "carp.html"
    target.parent.mkdir(exist_ok=True)
    carp = PHANTOMS["fish"].make((64, 128, 64))
    a, b = np.asarray(dn.project(carp, "-x", "mip").raster.spacing) * (128, 64)
    points = dn.ControlPoints.from_arrays(
        [[0.08 * a, 0.5 * b], [0.5 * a, 0.5 * b], [0.92 * a, 0.5 * b]],
        [[0.08 * a, 0.62 * b], [0.5 * a, 0.4 * b], [0.92 * a, 0.62 * b]],
        names=["head", "back", "tail"],
    )
    bend = dn.Deformation.from_picture_points(carp, "-x", points, trend="rigid")
    dn.Studio(carp, bend, side="-x").export_html(
        target, title="A carp", controls=["strength", "shows", "reset"], overwrite=True
    )
    dn.widgets.write_file_page(HERE / "_made" / "deformnb.html")
    dn.widgets.write_thompson_page(HERE / "_made" / "thompson.html", lessons="lessons.html")


def _make_profile() -> None:
    """The profile of the kernels: without their warning that other users of the machine could listen."""
    profile = Path(os.environ["IPYTHONDIR"]) / "profile_default"
    profile.mkdir(parents=True, exist_ok=True)
    (profile / "ipython_kernel_config.py").write_text("get_config().IPKernelApp.log_level = 40\n", encoding="utf-8")


def _make_lesson_pages() -> None:
    for name in LESSONS:
        write_lesson_page(name, HERE / "_made" / f"lesson_{name}.html", overwrite=True)


def _make_worksheets() -> None:
    """The worksheets of the lessons and their answers, a PDF for each lesson and language."""
    folder = HERE / "_made" / "worksheets"
    folder.mkdir(exist_ok=True)
    for code in LANGUAGES:
        write_answers(folder / f"answers_{code}.pdf", language=code)
        for name in LESSONS:
            write_worksheet(name, folder / f"{name}_{code}.pdf", language=code)


def _make_datasets() -> None:
    """The table of the volumes that are downloaded, as a part of a page."""
    rows = ["| name | what | credit | terms | from |", "|---|---|---|---|---|"]
    rows += [
        f"| `{name}` | {row.title} | {row.credit} | {row.licence} | {row.source} |" for name, row in DATASETS.items()
    ]
    (HERE / "api").mkdir(exist_ok=True)
    (HERE / "api" / "_datasets.md").write_text("\n".join(rows) + "\n", encoding="utf-8")


def _bibtex(kind: str, key: str, fields: dict[str, Any]) -> str:
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def _make_citation() -> None:
    """The entries of CITATION.cff as BibTeX, as a part of a page."""
    software = yaml.safe_load((HERE.parent / "CITATION.cff").read_text(encoding="utf-8"))
    (paper,) = software["references"]
    own = {
        "title": f"{software['title']}: {software['abstract']}",
        "author": " and ".join(f"{{{row['name']}}}" for row in software["authors"]),
        "version": software["version"],
        "url": software.get("repository-code", ""),
    }
    method = {
        "title": paper["title"],
        "author": " and ".join(f"{row['family-names']}, {row['given-names']}" for row in paper["authors"]),
        "booktitle": paper["collection-title"],
        "year": paper["year"],
        "pages": f"{paper['start']}--{paper['end']}",
        "doi": paper["doi"],
    }
    text = "\n\n".join([_bibtex("software", "deformnb", own), _bibtex("inproceedings", "correa2007volume", method)])
    (HERE / "api").mkdir(exist_ok=True)
    (HERE / "api" / "_citation.md").write_text(f"```bibtex\n{text}\n```\n", encoding="utf-8")


def _public() -> dict[str, list[str]]:
    """The names of each package, and those at the top, as ``dir()`` shows them."""
    inner = [value for name in dir(dn) if isinstance(value := getattr(dn, name), ModuleType)]
    packages = {package.__name__: package for package in (dn, *inner, deformnb_lessons)}
    return {
        name: [
            one
            for one in dir(package)
            if not one.startswith("_")
            and not isinstance(value := getattr(package, one), ModuleType)
            and not (isinstance(value, type) and not value.__module__.startswith("deformnb"))
        ]
        for name, package in packages.items()
    }


PUBLIC = _public()
PACKAGE_OF = {name: package for package, names in PUBLIC.items() for name in names if package != "deformnb"}


def _kind(package: str, name: str) -> str:
    value = getattr(importlib.import_module(package), name)
    return "Classes" if isinstance(value, type) else "Functions" if callable(value) else "Tables and constants"


def _make_reference() -> None:
    """A page for each package, and one for the names at the top, which leads to the pages of theirs."""
    folder = HERE / "api"
    folder.mkdir(exist_ok=True)
    for package, names in PUBLIC.items():
        is_top = package == "deformnb"
        text = f"{package}\n{'=' * len(package)}\n\n{importlib.import_module(package).__doc__}\n"
        for kind in ("Functions", "Classes", "Tables and constants"):
            shown = [name for name in names if _kind(package, name) == kind]
            elsewhere = [name for name in shown if is_top and name in PACKAGE_OF]
            if shown:
                text += "\n".join(["", kind, "-" * len(kind), ""])
            for options, listed in (("", elsewhere), ("   :toctree: generated\n", sorted({*shown} - {*elsewhere}))):
                if listed:
                    lines = [f"   ~{PACKAGE_OF[name] if name in elsewhere else package}.{name}" for name in listed]
                    text += "\n".join(["", ".. autosummary::", options, *lines, ""])
        page = folder / f"{package}.rst"
        if not page.exists() or page.read_text(encoding="utf-8") != text:  # Sphinx reads again what is newer
            page.write_text(text, encoding="utf-8")


def _find(app: Any, environment: Any, node: Any, content: Any) -> Any:
    """Docstrings name the module in which something is, such as deformnb.rbf.fitting.fit_rbf: it is shown as public."""
    if node.get("refdomain") != "py":
        return None
    parts = node["reftarget"].split(".")
    at = next((k for k, part in enumerate(parts) if part in PACKAGE_OF), None)
    if at is None:
        return None
    target = ".".join([PACKAGE_OF[parts[at]], *parts[at:]])
    domain = environment.get_domain("py")
    return domain.resolve_xref(environment, node["refdoc"], app.builder, "obj", target, node, content)


def _spread(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Write "name : what it is" of a table of parameters in two lines; numpydoc takes the first line for its type."""
    result, is_table = [], False
    for k, line in enumerate(lines):
        if k + 1 < len(lines) and re.fullmatch(r"-+", lines[k + 1]):
            is_table = line in ("Parameters", "Attributes")
        found = re.fullmatch(r"(\*{0,2}\w[\w, ]*) : (.+)", line) if is_table else None
        result += [line] if found is None else [found[1], f"    {found[2]}"]
    lines[:] = result


def _copy_notebooks() -> None:
    root = HERE.parent
    lessons = {path: f"lessons/{path.name}" for path in root.glob("lessons/deformnb_lessons/notebooks/*.ipynb")}
    named = {path: path.name for path in root.glob("notebooks/*.ipynb")} | lessons
    for former in {*HERE.glob("notebooks/**/*.ipynb")} - {HERE / "notebooks" / name for name in named.values()}:
        former.unlink()
    for notebook, name in named.items():
        copy = HERE / "notebooks" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if not copy.exists() or copy.read_bytes() != notebook.read_bytes():
            copy.write_bytes(notebook.read_bytes())


# -- navigation: the theme's arrows that show the pages below one have no text for a screen reader ---------------------
_ARROW = re.compile(r"(<a [^>]*>((?:(?!</a>).)*)</a>\s*<details[^>]*>\s*<summary)>", re.DOTALL)


def name_arrows(navigation: str) -> str:
    """The navigation in HTML, in which each arrow is named after the page whose pages it shows."""

    def name(found: re.Match[str]) -> str:
        title = re.sub(r"<[^>]*>", "", found[2]).strip().replace('"', "&quot;")
        return f'{found[1]} aria-label="Pages below {title}">'

    return _ARROW.sub(name, navigation)


def _name_navigation(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    make = context.get("generate_toctree_html")
    if make is not None:
        context["generate_toctree_html"] = lambda *args, **options: name_arrows(str(make(*args, **options)))


def setup(app: Any) -> None:
    """What Sphinx calls at the start of a build."""
    app.connect("html-page-context", _name_navigation, priority=900)  # after the theme
    app.add_html_math_renderer("mathml", _mathml("inline"), _mathml("block"))
    app.connect("autodoc-process-docstring", _spread, priority=100)  # before numpydoc
    app.connect("missing-reference", _find)
    _make_live_pages()
    _make_profile()
    _make_lesson_pages()
    _make_worksheets()
    _make_datasets()
    _make_citation()
    _make_reference()
    _copy_notebooks()
