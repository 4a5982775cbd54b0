"""The rendered book (setup/book.sh)."""
import os
import re
import shutil

project = "m4gn"
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["conf.py"]
html_theme = "furo"
html_title = "m4gn"
myst_heading_anchors = 4
HERE = os.path.dirname(os.path.abspath(__file__))


def contents(app, page, source):
    """The side bar is made of the links of the first page and of the lab's, in their order. Files beside the book are named, not linked."""

    def inside(link):
        text, target = link.groups()
        path = os.path.normpath(os.path.join(HERE, os.path.dirname(page), target.split("#")[0]))
        return link.group() if path.startswith(HERE) else f"{text} (`{os.path.relpath(path, os.path.dirname(HERE))}`)"

    source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\((\.\.[^)]*)\)", inside, source[0])
    if page.endswith("README"):
        for heading, text in re.findall(r"^#+ (.*?)\n(.*?)(?=^## |\Z)", source[0], re.M | re.S):
            pages = re.findall(r"\]\(([^)]*)\.md\)", text)
            if pages:
                source[0] += "\n```{toctree}\n:hidden:\n" + f":caption: {heading}\n" + "\n".join(pages) + "\n```\n"


def index(app, error):
    if not error and app.builder.format == "html":
        shutil.copy(os.path.join(app.outdir, "README.html"), os.path.join(app.outdir, "index.html"))


def setup(app):
    app.connect("source-read", contents)
    app.connect("build-finished", index)
