"""How the site is built: `make docs`, without the network; warnings are errors."""

import sys
from pathlib import Path

import kaju

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "_ext")]

project, author, release = "kaju", "The kaju developers", kaju.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "lesson_pages",
]
exclude_patterns = ["_build", "pages", "lessons/de", "lessons/ja"]
templates_path = ["_templates"]
myst_enable_extensions = ["dollarmath", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3
autosummary_generate = True
autodoc_default_options = {"exclude-members": "__init__, __new__"}  # Mesa's own are no valid reST
autodoc_typehints = "none"  # Parameters say it in words
autodoc_member_order = "bysource"
python_maximum_signature_line_length = 88
napoleon_google_docstring = False
napoleon_use_ivar = True
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
default_role = "public_name"  # of lesson_pages: a link where the name is public, else code
suppress_warnings = ["ref.python"]  # attributes of one name in several results
html_theme = "pydata_sphinx_theme"
html_title = "kaju"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.svg"
html_context = {"default_mode": "auto"}
html_show_sourcelink = False
html_show_search_summary = False  # it never ends where pages are opened as files
html_theme_options = {"show_prev_next": False, "secondary_sidebar_items": ["page-toc"]}
linkcheck_ignore = ["https?://.*"]  # only what leads to a place in the site itself is checked
