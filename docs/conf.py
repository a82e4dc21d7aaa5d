"""Settings of the documentation site, which is read from a folder, without a network."""

import sys
from pathlib import Path

from grasp3d import __version__

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "grasp3d"
author = "The grasp3d authors"
project_copyright = author
release = version = __version__
html_title = f"grasp3d {release}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "command_pages",
    "field_tables",
    "docstrings",
    "offline_math",
    "public_names",
]
exclude_patterns = ["_build", "_ext"]
smartquotes_action = "D"  # dashes; quotes stay as they are

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

autosummary_generate = False  # a page per name: `public_names`
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = False
python_maximum_signature_line_length = 80

default_role = "py:obj"  # a name in a docstring is a link where it is public

nitpicky = True
nitpick_ignore_regex = [  # other projects' names: their sites cannot be reached
    ("py:.*", r"(collections|numpy|np|os|pathlib|pyarrow|pandas|pd|pyvista|trimesh|upath)\..*"),
    ("py:.*", r"matplotlib\..*"),
    ("py:.*", r"grasp3d\.arrays\.ArrayLike"),  # NumPy's
    # Arrays and others, in modules that import them for type checkers only.
    ("py:class", r"Floats|Bools|ArrayLike|ObjectMotion|Progress|Triangles"),
    ("py:class", r".*\.\w*T|SettingsTs|.*\.(Annotated|InitVar)"),  # type variables and the like
    ("py:class", r".* \| .*"),  # type arguments of bases
    ("py:class", r"grasp3d\._kernels\..*|.*\._Part"),  # inside results
    ("py:obj", r".*"),  # parameters, and words in backticks
]

pygments_dark_style = "github-dark"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False
html_use_index = False  # thousands of attributes; the search finds them
html_search_scorer = str(Path(__file__).parent / "_ext" / "search_scorer.js")
html_show_search_summary = False  # it would have to read pages, which file:// does not allow
copybutton_prompt_text = "$ "
