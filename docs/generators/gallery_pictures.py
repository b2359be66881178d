"""Scrapers for sphinx-gallery: arms as thumbnails, figures drawn by flexlink outside pyplot, and films of a block."""

from __future__ import annotations

import importlib
import re
import shutil
from pathlib import Path
from typing import Any

from flexlink.describe.scene import Scene
from flexlink.results.plotting import NotebookFigure

EXAMPLES = Path(__file__).parents[2] / "examples"


class ByTheme:
    """Order of the thumbnails: that of the links in the gallery's header."""

    def __init__(self, _folder: str) -> None:
        header = (EXAMPLES / "GALLERY_HEADER.rst").read_text(encoding="utf-8")
        self.names = re.findall(r"sphx_glr_gallery_(\w+\.py)", header)

    def __call__(self, name: str) -> int:
        """Place of an example; those without a link are last."""
        return self.names.index(name) if name in self.names else len(self.names)


def arms(_block: object, block_vars: dict[str, Any], _gallery_conf: dict[str, Any]) -> str:
    """Draw the first scene of an example: the first picture is its thumbnail, and no page shows it."""
    names = block_vars["example_globals"]
    scene = next((value for value in names.values() if isinstance(value, Scene)), None)
    if scene is not None and "___arm" not in names:
        names["___arm"], figure = scene, scene.plot()
        view, *others = figure.axes
        view.set_axis_off()
        for part in (*figure.legends, *others):
            part.remove()
        for line in view.lines:
            line.set_linewidth(3.0)
        figure.savefig(block_vars["image_path_iterator"].next(), dpi=100, bbox_inches="tight")
    return ""


def pictures(_block: object, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Return the figure, or the film at the path, that is the value of a block, as reST; used in `image_scrapers`."""
    figure_rst = importlib.import_module("sphinx_gallery.scrapers").figure_rst
    names = block_vars["example_globals"]
    value, before = names.get("___"), names.get("___shown")  # a block without a value keeps the previous one
    if value is before:
        return ""
    names["___shown"] = value
    if isinstance(value, NotebookFigure):
        path = Path(block_vars["image_path_iterator"].next())
        twice = path.with_name(f"{path.stem}_2_00x.png")
        value.savefig(path, dpi=100)
        value.savefig(twice, dpi=200)
        return str(figure_rst([path], gallery_conf["src_dir"], srcsetpaths=[{0: path, 2.0: twice}]))
    if isinstance(value, Path) and value.suffix == ".gif":
        path = Path(block_vars["image_path_iterator"].next()).with_suffix(".gif")
        shutil.move(value, path)
        return str(figure_rst([path], gallery_conf["src_dir"], srcsetpaths=[{0: path}]))
    return ""
