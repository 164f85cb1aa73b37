"""What a release states in several places: its version and date, and the dependencies."""

import re
import tomllib
from pathlib import Path

import pytest

import pdsurrogate as pds

ROOT = Path(__file__).parents[1]
DEPENDENCIES = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
    "dependencies"
]


def found(pattern: str, name: str) -> list[str]:
    return re.findall(pattern, (ROOT / name).read_text("utf-8"), re.MULTILINE)


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("CITATION.cff", r"^version: (.*)"),
        ("docs/citing.md", r"^Version ([\d.]+), 20\d\d\.$"),
        ("docs/start/installation.md", r"pdsurrogate[ -](\d+\.\d+\.\d+)"),
        ("docs/development/recipe.yaml", r'^  version: "(.*)"'),
    ],
)
def test_the_version_is_the_same_everywhere(name, pattern):
    assert set(found(pattern, name)) == {pds.__version__}


def test_the_newest_release_in_the_changelog_is_this_version():
    version, date = re.search(
        r"^## \[(\d[\d.]*)\] - (\d{4}-\d\d-\d\d)$",
        (ROOT / "CHANGELOG.md").read_text("utf-8"),
        re.MULTILINE,
    ).groups()
    assert version == pds.__version__
    assert found(r"^date-released: (.*)", "CITATION.cff") == [date]


def test_the_recipe_has_the_dependencies_of_the_package():
    run = (
        (ROOT / "docs" / "development" / "recipe.yaml")
        .read_text("utf-8")
        .split("  run:\n")[1]
        .split("\ntests:")[0]
    )
    stated = {
        line.strip(" -").replace(" ", "").replace("matplotlib-base", "matplotlib")
        for line in run.splitlines()
        if line.strip()
    }
    assert stated == {*DEPENDENCIES, "python>=${{python_min}}"}


def test_the_oldest_versions_are_the_lower_bounds():
    oldest = dict(line.split("==") for line in found(r"^\w.*", ".ci/oldest.txt"))
    for dependency in DEPENDENCIES:
        name, bound = re.match(r"([\w-]+)>=([\d.]+)", dependency).groups()
        assert oldest[name] == (bound if bound.count(".") == 2 else f"{bound}.0"), dependency
