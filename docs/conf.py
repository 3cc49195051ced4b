"""Sphinx configuration of the documentation.

pip install ".[docs,warp]" && sphinx-build -W --keep-going docs build/site
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import runpy
import shutil
from pathlib import Path

import tomllib
from sphinx.application import Sphinx

os.environ["COLUMNS"] = "100"  # the width of the parsers' help
from dashpot.cli import parser

_ROOT = Path(__file__).parents[1]
# Pages of a site lie in one folder.
shutil.copytree(_ROOT / "notebooks", _ROOT / "docs/tutorials", dirs_exist_ok=True)
runpy.run_path(str(_ROOT / "docs/method_figures.py"))["main"]()
_PROJECT = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "dashpot"
author = "The dashpot authors"
copyright = author
release = _PROJECT["version"]

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "myst_nb",
]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # CI executes the notebooks by themselves
suppress_warnings = ["mystnb.unknown_mime_type"]
exclude_patterns = ["_build"]

# Pages are built without suites of environments, too.
autodoc_mock_imports = [name for name in ("dm_control",) if importlib.util.find_spec(name) is None]
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_preprocess_types = False

html_theme = "furo"
html_title = f"dashpot {release}"
html_show_copyright = False
html_copy_source = False
html_static_path = ["_static"]
html_js_files = ["filter_rows.js"]
html_search_language = "en"
# What to find first: headings of pages by page, and for each what is searched for.
SEARCH_TERMS = {
    "guides/calibrate": {"Calibrate": "calibration, fit"},
    "guides/compare": {"Compare with MuJoCo": "comparison"},
    "guides/engine_options": {
        '`impact="cut"`': "tunnelling, passing through",
        "`microsteps`, `max_microsteps`": "clipped, micro-steps",
    },
    "guides/from_mujoco": {"What the MJCF means": "solref, solimp, condim, integrator"},
    "guides/many_worlds": {"Derivatives": "derivative, gradient", "Rollouts": "batch, parallel"},
    "guides/materials": {
        "A stiffness": "N/m, stiffness, units",
        "Damping": "restitution, bounce, damping, N s/m",
        "Two geoms, one contact": "friction, combination",
        "Which numbers": "Young's modulus, hertz",
    },
    "guides/results": {"Contacts": "contact force", "Energy": "energy"},
    "guides/trouble": {
        "Penetration and softness": "penetration, overlap, soft, sink",
        "Slip, stiction and friction": "slip, creep, sliding, stick",
        "What makes steps slow": "slow, speed",
    },
    "guides/warp": {"Thousands of worlds on a GPU: `dashpot.warp`": "gpu, cuda, warp"},
    "method": {"2. One contact": "kelvin-voigt", "3. Friction": "stiction"},
}


def _name_source_files(_: Sphinx, __: str, source: list[str]) -> None:
    """Show links to files of the repository, which the site does not have, by their paths."""
    text = re.sub(r"\]\((?:\.\./)*notebooks/([\w]+)\.ipynb\)", r"](/tutorials/\1.ipynb)", source[0])
    text = re.sub(
        r"\[([^\]]+)\]\((?:(?:\.\./)+)?benchmarks/README\.md\)", r"[\1](/benchmarks.md)", text
    )
    source[0] = re.sub(
        r"\[([^\]]+)\]\((?:(?:\.\./)+)?((?:cpp|benchmarks|python)/[^)]+)\)", r"`\2`", text
    )


def _add_search_terms(_: Sphinx, page: str, source: list[str]) -> None:
    """Put main entries of the index below headings: the search lists these before all else."""
    for heading, terms in SEARCH_TERMS.get(page, {}).items():
        marked = ", ".join(f"! {term}" for term in terms.split(", "))
        found = re.search(rf"^#+ {re.escape(heading)}$", source[0], re.MULTILINE)
        if found is None:
            raise ValueError(f"{page} has no heading {heading!r}")
        index = f"\n\n```{{eval-rst}}\n.. index:: {marked}\n```\n"
        source[0] = source[0][: found.end()] + index + source[0][found.end() :]


def _print_parsers(_: Sphinx, page: str, source: list[str]) -> None:
    """Fill the page of the command line with what its parsers say of themselves."""
    if page != "reference/command_line":
        return
    root = parser()
    (commands,) = (a for a in root._actions if isinstance(a, argparse._SubParsersAction))
    texts = [f"```text\n{root.format_help()}```"]
    for name, command in commands.choices.items():
        texts.append(f"## dashpot {name}\n\n```text\n{command.format_help()}```")
    source[0] = source[0].replace("{{ command_line }}", "\n\n".join(texts))


def setup(app: Sphinx) -> None:
    """Register what reads pages before Sphinx does."""
    app.connect("source-read", _name_source_files)
    app.connect("source-read", _add_search_terms)
    app.connect("source-read", _print_parsers)
