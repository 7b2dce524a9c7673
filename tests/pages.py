"""What a browser would make of a page."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """Tags that are open, and what a browser would fetch."""

    VOID = {"meta", "br", "hr", "img", "link", "input"}

    def __init__(self, text):
        super().__init__()
        self.open, self.fetched, self.seen, self.heads, self._take = [], [], set(), [], False
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.seen.add(tag)
        self.fetched += [v for k, v in attributes if k in ("src", "href", "xlink:href", "data", "action")]
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
