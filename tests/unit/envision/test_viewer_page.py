import base64
import hashlib
import html.parser

from smarts.envision.viewer_page import Embedded, page_with, policy_of
from tests.viewers import PAGE

HOSTILE = "</script><img src=x onerror=alert(1)>\"'&"


class Tags(html.parser.HTMLParser):
    """Collects the tags of a page, with the data of scripts."""

    def __init__(self, text):
        super().__init__()
        self.found, self.texts = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.texts.append(data)


def test_episodes_come_back_from_the_page():
    episodes = [Embedded("1", "first", b"\0\1"), Embedded("2", HOSTILE, bytes(range(256)))]
    tags = Tags(page_with(episodes, PAGE))
    scripts = [attrs for tag, attrs in tags.found if tag == "script" and "data-id" in attrs]
    assert [(each["data-id"], each["data-label"]) for each in scripts] == [("1", "first"), ("2", HOSTILE)]
    for each in episodes:
        assert base64.b64encode(each.data).decode() in tags.texts
    assert not [tag for tag, _ in tags.found if tag == "img"]


def test_the_policy_names_the_code_and_the_style_that_were_built():
    digest = base64.b64encode(hashlib.sha256(b"let a = 1;").digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy_of(PAGE)
    with_episode = page_with([Embedded("1", "first", b"\0")], PAGE)
    (policy,) = (
        attrs["content"]
        for tag, attrs in Tags(with_episode).found
        if attrs.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy == policy_of(PAGE) == policy_of(with_episode)
