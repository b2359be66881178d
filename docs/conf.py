"""Sphinx configuration; `python -m docs` uses it."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # lets a plain sphinx-build find the checkout as well

from docs.generators import inventories  # noqa: E402
from flexlink.common.versions import __version__  # noqa: E402

project = "flexlink"
author = copyright = "The flexlink developers"
version = release = __version__
extensions = [
    "sphinx.ext.autodoc",
    "docs.snippets",
    "docs.generators",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",
]
exclude_patterns = ["_site", "_doctrees", "generators", "inventories", "paper", "**sg_execution_times.rst", "**.ipynb"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "attrs_inline", "substitution"]
myst_heading_anchors = 3
myst_substitutions = {"version": __version__}
templates_path = ["templates"]
suppress_warnings = ["config.cache"]  # the gallery's settings contain a function
default_role = "code"
smartquotes = False  # keeps "--set" unchanged
autodoc_typehints = "none"  # shapes and units are in the text
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
nitpicky = True
nitpick_ignore_regex = [(r"py:.*", r"(numpy\._typing|numpy\.typing|flexlink\.common|msgspec)\b.*")]
intersphinx_mapping = inventories.mapping(HERE / "inventories")
intersphinx_timeout = 1

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "ignore_repr_types": r".*(NotebookFigure|Path).*",
    "image_scrapers": (
        "docs.generators.gallery_pictures.arms",
        "matplotlib",
        "docs.generators.gallery_pictures.pictures",
    ),
    "filename_pattern": r"\.py$",
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "within_subsection_order": "docs.generators.gallery_pictures.ByTheme",
    "write_computation_times": False,
    "copyfile_regex": r".*\.(urdf|xml|toml|csv)",
    "notebook_images": False,
    "reset_modules": ("matplotlib",),
}

html_theme = "pydata_sphinx_theme"
html_title = "flexlink"
html_static_path = ["static"]
html_css_files = ["flexlink.css"]
html_js_files = ["flexlink.js"]
html_show_sourcelink = False
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 5,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
