"""Sphinx configuration: `make docs` builds the site in build/docs."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]

import yawrate_env  # noqa: E402

project, author = "yawrate", "The yawrate developers"
version = release = yawrate_env.__version__
copyright = "The yawrate developers, MIT licence"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["build", "_templates"]
templates_path = ["_templates"]
html_theme = "furo"
html_title = f"yawrate {version}"
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
autosummary_generate = True
autodoc_typehints = "none"  # docstrings say more
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "ignore-module-all": True}
napoleon_numpy_docstring, napoleon_google_docstring = True, False
napoleon_use_rtype = False
default_role = "code"
add_module_names = False
suppress_warnings = ["ref.python"]  # a name may stand in a package and in its module


def setup(app):
    """Links that work in the repository's files work on the site, too."""
    app.connect("source-read", relinked)
    app.connect("autodoc-process-docstring", plain_bars)
    app.connect("include-read", lambda app, path, parent, text: relinked(app, parent, text))


def relinked(app, document, text):
    """Point links to pages of results at the site's own; leave other files' names as text."""
    up = "../" * document.count("/")
    text[0] = re.sub(r"\[([^\]]+)\]\([\w.]+\.(?:json|csv)\)", r"`\1`", text[0])
    text[0] = re.sub(r"(\]\([^)]*results/)README\.md", r"\1index.md", text[0])
    text[0] = re.sub(r"\]\((?:\.\./)?results/([\w.]+\.md)", rf"]({up}results/\1", text[0])
    text[0] = re.sub(r"\]\((?:\.\./)?docs/([\w.]+\.md)", rf"]({up}\1", text[0])
    text[0] = re.sub(r"(?<!!)\[([^\]]+)\]\((?:\.\./)+(?!results|figures)[^)]*\)", r"\1", text[0])


def plain_bars(app, what, name, object, options, lines):
    """Show Markdown tables and what is set off as they are; a bar is nothing special elsewhere."""
    found, inside, literal, last = [], False, None, ""
    for line in lines:
        indent = line[: len(line) - len(line.lstrip())]
        begins = (
            line.strip() and found and not found[-1].strip() and not last.startswith((":", ".."))
        )
        if literal is None and begins and len(indent) >= 4 and not last.startswith(" "):
            found += ["::", ""]  # what is set off is a formula or a file
            literal = 0
        if literal is not None and line.strip() and len(indent) <= literal:
            literal = None
        row = literal is None and line.lstrip().startswith("|") and line.rstrip().endswith("|")
        if row and not inside:
            found += [f"{indent}::", ""]
        if inside and not row:
            found.append("")
        code = literal is not None or "``" in line
        found.append(f"   {line}" if row else line if code else line.replace("|", "\\|"))
        inside, last = row, line if line.strip() else last
        if literal is None and line.rstrip().endswith("::"):
            literal = len(indent)
    lines[:] = found
