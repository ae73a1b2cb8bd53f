"""Configuration of the site: `make docs`, and rosdoc2."""

import logging
import os
import re
import sys
import sysconfig
from pathlib import Path

# rosdoc2 executes this file in a copy of its folder, from a file that names it.
_named = re.search(r'^exec\(open\("(.+?)"\)', Path(__file__).read_text("utf-8"), re.MULTILINE)
HERE = Path(_named[1] if _named else __file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
# The notebooks run `mbd_sim` of the environment in which Sphinx runs; it need not be the active one.
_profile = HERE / "_build" / "ipython" / "profile_default"  # not the user's own
_profile.mkdir(parents=True, exist_ok=True)
(_profile / "ipython_kernel_config.py").write_text('get_config().IPKernelApp.log_level = "ERROR"\n', "utf-8")
os.environ["IPYTHONDIR"] = str(_profile.parent)
logging.getLogger("traitlets").setLevel(logging.WARNING)  # which reports each notebook
os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)])

project = "mbd_sim"
author = "mbd_sim maintainers"
copyright = author
release = version = re.search(r'__version__ = "([^"]+)"', (HERE.parent / "mbd_sim/__init__.py").read_text("utf-8"))[1]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "site_pages",
]
exclude_patterns = ["_build", "gallery.md"]  # the gallery of the site is generated, one page for each mechanism
rosdoc2_settings = {
    "automatically_extend_intersphinx_mapping": False,
    "enable_autodoc": False,  # it is enabled above, and no module needs to be replaced
    "enable_intersphinx": False,
    "override_theme": False,
    "support_markdown": False,  # myst_nb does
}
root_doc = "index"
default_role = "code"
smartquotes_action = "qe"  # quotes and dots, but no dashes, which would change options such as --set
nitpicky = False

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 5
myst_dmath_double_inline = True

nb_execution_in_temp = True
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 60  # s, for each cell
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_preserve_defaults = True
python_display_short_literal_types = True
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"mbd_sim {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True


def setup(app):
    """Called by Sphinx: rosdoc2 builds this folder rather than its copy, whose links to other folders lead nowhere."""
    app.connect("config-inited", lambda app, config: setattr(app, "srcdir", type(app.srcdir)(HERE)), priority=1)
