"""The site: what the hooks of its build refuse, and what the built pages hold. It needs the
extra "docs", which .ci/run installs first.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from refusals import raising

SITE = Path(__file__).parents[1] / "docs" / "site"
sys.path.insert(0, str(SITE))
hooks = pytest.importorskip(
    "hooks",
    reason='needs what builds the site: pip install "pdsurrogate[docs]"',
    exc_type=ImportError,
)


def translated(equation):
    content = f'<div class="arithmatex">\\[\n{equation}\n\\]</div>'
    page = SimpleNamespace(file=SimpleNamespace(src_uri="page.md"), toc=[], meta={})
    return hooks.on_page_content(content, page, None, None)


@pytest.mark.parametrize(
    "equation",
    [
        r"a &amp; b",
        r"\nonsense x",
        r"\begin{aligned} a &amp;= b \\ c &amp;= d \end{aligned}",
        r"\begin{gathered} a \\ b \end{gathered}",
    ],
)
def test_equations_without_mathml_fail_the_build(equation):
    with raising("no MathML", hooks.PluginError):
        translated(equation)


def test_lines_of_an_equation_are_aligned_and_numbered():
    found = translated(r"\begin{split} a &amp;= b &lt; c \\ d &amp;= e \end{split} \tag{7}")
    assert found.count("<mtr>") == 2
    assert 'id="eq-7"' in found
    assert "<span>(7)</span>" in found


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "-f",
        str(SITE / "mkdocs.yml"),
        "-d",
        str(folder),
    ]
    subprocess.run(command, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    return folder


@pytest.mark.slow  # the whole site is built
def test_pages_fetch_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        assert not re.findall(
            r'<(?:script|img|iframe)[^>]*\ssrc="?(?:https?:)?//[^>]*>|<link[^>]*\shref="?https?://[^>]*>',
            page.read_text(),
        )


@pytest.mark.slow
def test_search_keeps_components_and_decimal_numbers_whole(site):
    index = json.loads((site / "search" / "search_index.json").read_text())
    separator = re.compile(index["config"]["separator"])
    words = {
        word
        for entry in index["docs"]
        for word in separator.split(re.sub("<[^>]*>", " ", entry["text"]))
        if word
    }
    assert {"stress_11", "horizon_ratio", "0.05", "NOSBForce", "viscosity"} <= words
    assert "dynamics.viscosity" not in words


@pytest.mark.slow
def test_signatures_of_models_have_plain_types(site):
    page = re.sub("<[^>]*>", "", (site / "reference" / "api" / "scenes.html").read_text())
    signature = re.search(r"Scene\(\s*\*,.*?\n\)", page, re.DOTALL)[0]
    assert "spacing: float | None," in signature
    assert "Annotated" not in signature
