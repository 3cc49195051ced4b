"""Sphinx configuration of the documentation.

pip install ".[docs]" && sphinx-build -W --keep-going docs build/site
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
from pathlib import Path

import tomllib
from sphinx.application import Sphinx

os.environ["COLUMNS"] = "100"  # the width of the parsers' help
from dashpot.cli import parser

_ROOT = Path(__file__).parents[1]
# Pages of a site lie in one folder.
shutil.copytree(_ROOT / "notebooks", _ROOT / "docs/tutorials", dirs_exist_ok=True)
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

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_preprocess_types = False

html_theme = "furo"
html_title = f"dashpot {release}"
html_show_copyright = False
html_copy_source = False
# Words that stand in many pages: the search puts titles first.
html_search_language = "en"


def _name_source_files(_: Sphinx, __: str, source: list[str]) -> None:
    """Show links to files of the repository, which the site does not have, by their paths."""
    text = re.sub(r"\]\((?:\.\./)*notebooks/([\w]+)\.ipynb\)", r"](/tutorials/\1.ipynb)", source[0])
    text = re.sub(
        r"\[([^\]]+)\]\((?:(?:\.\./)+)?benchmarks/README\.md\)", r"[\1](/benchmarks.md)", text
    )
    source[0] = re.sub(
        r"\[([^\]]+)\]\((?:(?:\.\./)+)?((?:cpp|benchmarks|python)/[^)]+)\)", r"`\2`", text
    )


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
    app.connect("source-read", _print_parsers)
