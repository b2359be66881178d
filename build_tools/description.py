"""The description of the package: the README for readers outside its repository."""

from __future__ import annotations

import re
from urllib.parse import urljoin

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s]+)\)")


def standalone(text: str, source: str = "") -> str:
    """Return Markdown without pictures, comments and links that exist only in a repository.

    Parameters
    ----------
    text
        Markdown with relative links.
    source
        Address of the files in the repository, which makes links absolute. Default: links become their text.
    """
    text = re.sub(r"<!--.*?-->\n?", "", text, flags=re.DOTALL)

    def absolute(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if re.match(r"[a-z]+:", target):
            return link[0]
        if picture:
            return ""
        if target.startswith("#"):
            return words
        return f"[{words}]({urljoin(source.rstrip('/') + '/', target)})" if source else words

    text = re.sub(r"[ \t]+$", "", LINK.sub(absolute, text), flags=re.MULTILINE)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
