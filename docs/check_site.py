"""Check a built site: links within it, the form of links out of it, and what its search puts first.

python docs/check_site.py build/site        (of a fresh build: sphinx-build -E)
"""

from __future__ import annotations

import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# What a reader searches for, and the page that has to come first.
FIRST = {
    "slip": "guides/trouble",
    "penetration": "guides/trouble",
    "restitution": "guides/materials",
    "solref": "guides/from_mujoco",
    "n/m": "guides/materials",
}


class Page(HTMLParser):
    """The anchors of a page, and where its links lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what a tag names, and what it refers to."""
        values = dict(attrs)
        self.anchors.update(v for v in (values.get("id"), values.get("name")) if v)
        link = values.get("href") if tag in ("a", "link") else values.get("src")
        if link:
            self.links.append(link)


def broken_links(site: Path) -> list[str]:
    """Return links that lead nowhere within the site, and links out of it that are no address."""
    pages = {p.resolve(): Page(p.read_text(encoding="utf-8")) for p in site.rglob("*.html")}
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https"):
                right = re.fullmatch(r"[\w-]+(\.[\w-]+)+(:\d+)?", parts.netloc) and " " not in link
            elif parts.scheme:
                right = parts.scheme in ("mailto", "data", "javascript")
            else:
                target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                right = target.exists() and (
                    not parts.fragment
                    or target not in pages
                    or unquote(parts.fragment) in pages[target].anchors
                )
            if not right:
                broken.append(f"{path.relative_to(site.resolve())}: {link}")
    return broken


def misled_searches(site: Path) -> list[str]:
    """Return searches that another page answers first, or several.

    A main entry of the index that is the query counts 100 in Sphinx's search, a title at most 16,
    and the name of an object 26.
    """
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text[text.index("{") : text.rindex("}") + 1])
    misled = []
    for query, page in FIRST.items():
        entries = index["indexentries"].get(query, [])
        found = {index["docnames"][document] for document, _, main in entries if main}
        if found != {page}:
            misled.append(f"a search for {query!r} leads to {sorted(found)}, not to {page}")
    return misled


if __name__ == "__main__":
    site = Path(sys.argv[1])
    wrong = broken_links(site) + misled_searches(site)
    sys.exit("\n".join(wrong) or 0)
