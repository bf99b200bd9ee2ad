"""The site: `make docs` builds it into build/docs. Warnings are errors, and nothing comes from the network."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

from dynid_rs import __version__  # noqa: E402  # the extensions above need no package

project = "dynid_rs"
author = "the dynid_rs contributors"
copyright = "the dynid_rs contributors, MIT or Apache-2.0"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "generated",
    "mathml",
    "notebook_files",
    "picture",
    "stub",
    "terminal",
]
exclude_patterns = ["_build", "_extensions"]
smartquotes_action = "D"  # dashes only: quotes stay what one types
nitpicky = True
default_role = "code"  # docstrings write `name` as Markdown does

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

# Every notebook and every command is run at every build: what stands on a page is what the program says today.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True  # what they write is theirs, and stays out of the checkout
nb_execution_timeout = 600  # by the wall clock, which other programs share
nb_merge_streams = True
nb_kernel_rgx_aliases = {".*": "python3"}

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "none"  # docstrings say shapes and units, which hints cannot
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]  # several names in a line, and their last underscores
napoleon_use_rtype = False
napoleon_preprocess_types = False

html_theme = "furo"
html_title = "dynid_rs"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_logo = "_static/favicon.svg"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    "sidebar_hide_name": False,
    "light_css_variables": {"color-brand-primary": "#0b6e6e", "color-brand-content": "#0b6e6e"},
    "dark_css_variables": {"color-brand-primary": "#4fd1c5", "color-brand-content": "#4fd1c5"},
}
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True
