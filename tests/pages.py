"""What a browser would make of a page."""

import itertools
import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """Tags that are open, what a browser would fetch, links and headings."""

    VOID = {"meta", "br", "hr", "img", "link", "input"}

    def __init__(self, text):
        super().__init__()
        self.open, self.fetched, self.seen, self.heads, self._take = [], [], set(), [], False
        self.links, self.elements = [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.seen.add(tag)
        places = [v for k, v in attributes if k in ("src", "href", "xlink:href", "data", "action")]
        (self.links if tag == "a" else self.fetched).extend(one for one in places if not one.startswith("data:"))
        self.elements.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)
        self._take = tag == "h2"

    def handle_startendtag(self, tag, attributes):
        self.seen.add(tag)

    def handle_endtag(self, tag):
        assert self.open[-1:] == [tag], f"{tag} closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, text):
        if self._take:
            self.heads.append(text)
        self._take = False


def faults(text, *, whole=True):
    """What is wrong with the structure of a page (``whole``) or of a card, for readers who do not see it."""
    page = Page(text)
    tags = [tag for tag, _ in page.elements]
    ids = [own["id"] for _, own in page.elements if "id" in own]
    found = [f"{tags.count(tag)} {tag}" for tag in ("h1", "main", "footer") if whole and tags.count(tag) != 1]
    found += [f"id {one} twice" for one in set(ids) if ids.count(one) > 1]
    found += [f"no place {one}" for one in page.links if one.startswith("#") and one[1:] not in ids]
    found += [f"{tags.count('table')} tables, {tags.count('caption')} captions"] * (
        tags.count("table") != tags.count("caption")
    )
    for tag, own in page.elements:
        wanted = {"th": ["scope"], "svg": ["role", "aria-label"], "nav": ["aria-label"]}.get(tag, [])
        wanted = [*wanted, *(["id"] if whole and tag in ("h2", "h3") else [])]
        wanted = [*wanted, *(["role", "aria-label"] if "tabindex" in own and tag != "pre" else [])]
        found += [f"{tag} without {name}: {own}" for name in wanted if not own.get(name)]
    levels = [int(tag[1]) for tag in tags if tag in ("h1", "h2", "h3")]
    found += [f"h{a} before h{b}" for a, b in itertools.pairwise(levels) if b > a + 1]
    return found


def unexplained(text):
    """Colours that are drawn on a page and that no legend of it explains."""
    drawn = set(re.findall(r'class="(?:line|dot|fill) ([\w-]+)', text)) - {"explained", "zero"}
    drawn |= {"noise"} & set(re.findall(r'class="(noise)"', text))
    return drawn - set(re.findall(r"--c:var\(--([\w-]+)\)", text))
