"""Sphinx configuration: `make docs` builds the site in build/docs."""

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
    "sphinx.ext.viewcode",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["build", "_templates"]
templates_path = ["_templates"]
html_theme = "furo"
html_title = f"yawrate {version}"
html_static_path = ["_static"]
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
autosummary_generate = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_numpy_docstring, napoleon_google_docstring = True, False
napoleon_use_rtype = False
default_role = "code"
nitpicky = False
