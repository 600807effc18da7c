"""Checks of HTML pages."""

import re
from html.parser import HTMLParser


class Checked(HTMLParser):
    """Fails on tags that do not match; collects identities and links."""

    VOID = {"meta", "br", "img", "input", "link", "path", "use", "rect", "stop"}

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.loaded = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        self.loaded += [v for k, v in attrs if k in ("src", "href", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def check_whole(page, pictures):
    """Well-formed, with so many pictures, and self-contained."""
    found = Checked(page)
    assert len(found.ids) == len(set(found.ids)) > 10
    assert all(link.startswith("#") for link in found.loaded)
    assert "@import" not in page and "url(http" not in page and len(page) < 1e6
    shown = without_scripts(page)
    assert shown.count("<svg") == pictures
    assert "NaN" not in shown and "None" not in shown


def without_scripts(page):
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
