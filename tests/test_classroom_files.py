"""Files of a class on a server: Binder's and JupyterHub's, of which only the syntax can be tested here."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from deformnb_lessons import LESSONS

ROOT = Path(__file__).resolve().parents[1]
MEGABYTE = {"M": 1, "G": 1000}


def values() -> dict[str, Any]:
    return dict(yaml.safe_load((ROOT / "hub" / "values.yaml").read_text(encoding="utf-8")))


def megabytes(text: str) -> float:
    number, unit = re.fullmatch(r"(\d+)([MG])", text).groups()  # type: ignore[union-attr]
    return int(number) * MEGABYTE[unit]


def test_the_steps_of_the_image_are_a_script_that_can_be_run() -> None:
    script = ROOT / "binder" / "postBuild"
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", str(script)], check=True)
    for name in re.findall(r"lessons/\S+/\*\S+", script.read_text(encoding="utf-8")):
        assert list(ROOT.glob(name)), f"{name} is not there"


def test_pip_takes_every_line_of_the_requirements() -> None:
    environment = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))["dependencies"][-1]["pip"]
    for line in (*(ROOT / "binder" / "requirements.txt").read_text(encoding="utf-8").splitlines(), *environment):
        assert re.fullmatch(r"#.*|(--editable )?\.(\[[a-z,]+\]|/lessons)?", line), (
            f"{line!r}: pip options are no requirements"
        )


def test_the_hub_opens_lessons_that_are_there_with_the_memory_that_was_measured() -> None:
    lessons = {lesson.notebook for lesson in LESSONS.values()}
    user = values()["singleuser"]
    opened = [user["defaultUrl"], *(p["kubespawner_override"]["default_url"] for p in user["profileList"][1:])]
    assert {address.rsplit("/", 1)[1] for address in opened} <= lessons
    made = re.search(r"mkdir -p (\w+)", (ROOT / "binder" / "postBuild").read_text(encoding="utf-8"))[1]  # type: ignore[index]
    assert {address.split("/")[-2] for address in opened} == {made}
    assert not (ROOT / made).exists(), "the folder of pupils is no folder of the repository"
    config = (ROOT / "hub" / "jupyterhub_config.py").read_text(encoding="utf-8")
    assert set(re.findall(r"[\w]+\.ipynb", config)) <= lessons
    page = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
    said = int(re.search(r"plan (\d+) MB for each pupil", page)[1])  # type: ignore[index]
    guaranteed = [user["memory"]["guarantee"], re.search(r'mem_guarantee = "(\w+)"', config)[1]]  # type: ignore[index]
    assert [megabytes(text) for text in guaranteed] == [said, said]


@pytest.mark.nightly
def test_repo2docker_reads_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    packs = pytest.importorskip("repo2docker.buildpacks")
    monkeypatch.chdir(ROOT)
    pack = packs.PythonBuildPack(base_image="docker.io/library/buildpack-deps:jammy")
    pack.platform = "linux/amd64"
    assert pack.detect()
    assert not packs.CondaBuildPack(base_image="").detect(), "an environment for conda would win"
    image = pack.render()
    assert 'pip install --no-cache-dir -r "binder/requirements.txt"' in image
    assert "libegl1" in image
    assert "RUN ./binder/postBuild" in image
    assert image.index("COPY --chown=1000:1000 src/ ") < image.index('binder/requirements.txt"'), "it installs ."


@pytest.mark.nightly
def test_jupyterhub_takes_its_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    hub = pytest.importorskip("jupyterhub.app").JupyterHub
    monkeypatch.setenv("CLASS_PASSWORD", "secret")
    file = ROOT / "hub" / "jupyterhub_config.py"
    app = hub(config_file=str(file))
    app.load_config_file(str(file))
    known = {cls.__name__: cls.class_traits() for cls in (*app.classes, hub)}
    for name, settings in app.config.items():
        if name in known:  # a spawner or authenticator by its short name is looked up when the hub starts
            assert set(settings) <= set(known[name]), name
    assert app.config.JupyterHub.spawner_class == "simple"
