"""How Sphinx makes the site. tools/build_docs puts the pages where it reads them; see docs/development.md."""

import os

project = "Palpate"
copyright = "the authors of Palpate"
release = version = os.environ["PALPATE_VERSION"]
html_title = f"Palpate {release}"

extensions = ["myst_parser", "breathe", "sphinx.ext.mathjax"]
root_doc = "index"
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
nitpicky = False  # the API names types of the standard library
highlight_language = "none"

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4  # as web forges make them
myst_update_mathjax = False

# Debian's MathJax 2, copied beside the pages: they load nothing from elsewhere
mathjax_path = "mathjax/MathJax.js?config=TeX-AMS_SVG"
mathjax2_config = {
    "messageStyle": "none",
    "SVG": {"linebreaks": {"automatic": True}},
    "showMathMenu": False,  # it offers to load more
}

breathe_projects = {"palpate": os.environ["PALPATE_DOXYGEN_XML"]}
breathe_default_project = "palpate"
breathe_show_include = False

html_theme = "furo"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_favicon = "../../web/src/icon.svg"
html_show_sphinx = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#7a3b00", "color-brand-content": "#8a4300"},
    "dark_css_variables": {"color-brand-primary": "#ffb37a", "color-brand-content": "#ffa868"},
}
