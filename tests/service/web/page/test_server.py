"""What lies between the page and its server: weight, breaks, other tabs, reloads, keys, networks."""

import re

import httpx2
import pytest
from playwright.sync_api import expect

from tests.support.browser import needs_browser
from tests.support.browser.page import (
    SMALL,
    choose,
    choose_mode,
    go_to,
    open_scene,
    set_field,
    wait_for_picture,
    wait_for_rest,
)
from tests.support.inputs import CUBE, EIA_PNG
from tests.support.servers import Line
from tests.support.web import serve_app

pytestmark = [needs_browser, pytest.mark.slow]
LONG = "#scene=vase&lenses=500x500&pixels=15x15&show=around"
"""The address of a job that takes many seconds."""
KEY = "a-secret-key"
EURO_KEY = "a-secret-\u20ac"
UNFINISHED = re.compile("waiting|running")


@pytest.fixture
def line(server):
    """Leads to the server, until it is cut."""
    line = Line(int(server.rpartition(":")[2]))
    yield line
    line.cut()


def wait_for_progress(page):
    expect(page.locator("#progress-text")).to_contain_text(re.compile(r"\d+ of 225 views"))


def test_the_page_weighs_little_until_a_mesh_is_opened(page):
    sizes, names = {}, {}
    devtools = page.context.new_cdp_session(page)
    devtools.on("Network.responseReceived", lambda event: names.update({event["requestId"]: event["response"]["url"]}))
    devtools.on("Network.loadingFinished", lambda event: sizes.update({event["requestId"]: event["encodedDataLength"]}))
    devtools.send("Network.enable")
    devtools.send("Network.setCacheDisabled", {"cacheDisabled": True})
    page.reload()
    for mode in ("around", "compare"):
        go_to(page, f"{SMALL}&show={mode}")
        expect(page.locator("#status")).to_contain_text("Done in")
    own = {name: sizes.get(number, 0) for number, name in names.items() if not re.search("/v1/|^blob:", name)}
    assert any(name.endswith("compare.js") for name in own)
    assert not any("three" in name for name in own)
    assert sum(own.values()) < 300_000, own


def test_a_job_is_followed_over_a_break_of_the_server_and_cancelled(browser, server, line):
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{line.port}/{LONG}")
    wait_for_progress(page)
    line.cut()
    problem = page.get_by_role("alert")
    expect(problem).to_contain_text("The server does not answer. Check that it runs, then try again.")
    expect(page.locator("#job")).to_be_hidden()
    page.get_by_role("button", name="Try again").click()
    expect(problem).to_contain_text("does not answer")
    line.mend()
    page.get_by_role("button", name="Try again").click()
    wait_for_progress(page)
    expect(problem).to_be_hidden()
    with page.expect_response(lambda response: response.request.method == "DELETE") as deleted:
        page.get_by_role("button", name="Cancel").press("Enter")
    assert page.request.get(deleted.value.url).json()["state"] == "cancelled"
    expect(page.locator("#restart")).to_be_focused()
    expect(page.locator("#job")).to_be_hidden()
    expect(page.locator("#status")).to_have_text("Cancelled.")
    page.context.close()


def test_the_share_that_has_been_sent_is_shown_and_sending_is_cancelled(page):
    devtools = page.context.new_cdp_session(page)
    devtools.send("Network.enable")
    line = {"offline": False, "latency": 0, "downloadThroughput": -1}
    devtools.send("Network.emulateNetworkConditions", line | {"uploadThroughput": 60_000})
    choose(page, ("cube.off", CUBE + b"#" * 600_000))
    expect(page.locator("#progress-text")).to_have_text(re.compile(r"Sending, [1-9]\d? %"))
    assert 0 < float(page.locator("#progress").get_attribute("value")) < 1
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#status")).to_have_text("Cancelled.")
    expect(page.locator("#job")).to_be_hidden()
    devtools.send("Network.emulateNetworkConditions", line | {"uploadThroughput": -1})
    page.get_by_role("button", name="Try again").click()
    expect(page.locator("#kind")).to_have_text("A mesh")


def test_two_tabs_share_the_server_and_the_list_of_jobs(page):
    page.expected = ["409"]
    open_scene(page)
    other = page.context.new_page()
    other.goto(page.url.replace("vase", "globe"))
    wait_for_picture(other, 40, 60)
    assert "globe" in other.url
    assert "vase" in page.url
    expect(page.locator("#recent-list")).to_contain_text("Globe")
    for tab in (page, other):
        go_to(tab, f"{LONG}&rotate=9,0,0")
        wait_for_progress(tab)
    expect(page.locator("#recent-list")).to_contain_text("running")
    other.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("alert")).to_contain_text("Another window or program cancelled this job.")
    expect(other.locator("#status")).to_have_text("Cancelled.")
    go_to(page, SMALL)
    wait_for_picture(page, 40, 60)


def test_a_key_is_kept_as_long_as_the_tab_alone(browser, tmp_path):
    with serve_app(tmp_path, api_keys=KEY) as server:
        context = browser.new_context()
        asked = []
        context.on("request", lambda request: asked.append(request.url))
        page = context.new_page()
        page.goto(f"{server.url}#file=eia.png&lenses=6x9&show=mapped")
        choose(page, ("eia.png", EIA_PNG))
        for key in ("wrong", "wrong\u20ac", f"\u200b {KEY[:4]}\u200b{KEY[4:]} \ufeff"):
            with page.expect_response("**/v1/files"):
                page.get_by_label("Key of this server").fill(key)
                page.get_by_role("button", name="Use key").click()
            if "wrong" in key:
                expect(page.get_by_role("alert")).to_contain_text("the API key is not known")
        wait_for_picture(page, 6, 9)
        expect(page.locator("[name=model] option").nth(1)).to_be_attached()
        page.get_by_role("radio", name="Look around").check()
        wait_for_rest(page)
        kept = "async () => [JSON.stringify({ ...localStorage }), await indexedDB.databases(), await caches.keys()]"
        lasting, *others = page.evaluate(kept)
        assert "eia.png" in lasting  # the jobs
        assert KEY not in lasting
        assert others == [[], []]
        assert context.cookies() == []
        assert not any(KEY in url for url in [page.url, *asked])
        other = context.new_page()
        other.goto(page.url)
        choose(other, ("eia.png", EIA_PNG))
        expect(other.get_by_label("Key of this server")).to_be_visible()
        context.close()


def test_a_key_may_have_any_character(browser, tmp_path):
    with serve_app(tmp_path, api_keys=EURO_KEY) as server:
        page = browser.new_page()
        page.goto(f"{server.url}{SMALL}")
        field = page.get_by_label("Key of this server")
        expect(field).to_be_focused()
        field.fill(EURO_KEY)
        field.press("Enter")
        wait_for_picture(page, 40, 60)
        expect(page.locator("#name")).to_be_focused()
        page.context.close()


def test_networks_that_the_server_cannot_run_are_not_offered(page):
    models = [
        {"name": name, "scales": [2], "unsupported_reason": reason}
        for name, reason in (("fast", None), ("int8", "no VNNI"))
    ]
    page.route("**/v1/models", lambda route: route.fulfill(json=models))
    go_to(page, f"{SMALL}&show=compare&model=fast")
    page.reload()
    options = page.locator("#settings [name=model] option")
    expect(options).to_have_text(["Automatic", "fast", "int8"])
    expect(options.nth(1)).to_be_enabled()
    expect(options.nth(2)).to_be_disabled()
    expect(options.nth(2)).to_have_attribute("title", "no VNNI")
    compared = page.get_by_label("Picture on the left").locator("option")
    expect(compared.filter(has_text="fast")).to_have_count(1)
    expect(compared.filter(has_text="int8")).to_have_count(0)


@pytest.mark.parametrize(("mode", "name"), [("Upscaled", "cube_view.png"), ("Look around", "cube_views_tiles.zip")])
def test_a_recent_job_is_downloaded_after_a_reload(page, mode, name):
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3")
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 40, 40)
    expect(page.locator("#save")).to_be_hidden()  # there is the form for exports
    choose_mode(page, mode)
    entry = page.get_by_role("button", name=f"cube.off: {mode.lower()}")
    expect(entry).to_be_visible()
    page.reload()
    entry.click()
    expect(page.locator("#frame").locator("img, canvas")).to_be_visible()
    status = page.locator("#status")
    expect(status).to_contain_text("Done in")
    shown = status.text_content()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    assert download.value.suggested_filename == name
    assert download.value.path().stat().st_size > 100
    assert status.text_content() == shown
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    expect(page.locator("#save")).to_be_hidden()


def test_a_job_is_awaited_after_a_reload(page):
    go_to(page, "#file=cube.off&lenses=100x100&pixels=5x5&show=mapped")
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 100, 100)
    page.route("**/v1/*/*/events", lambda _: None)  # the page waits as long as no event comes
    choose_mode(page, "Upscaled")
    entry = page.get_by_role("button", name="cube.off: upscaled")
    expect(entry).to_contain_text(UNFINISHED)
    page.unroute_all()
    page.reload()
    entry.click()
    wait_for_picture(page, 200, 200)
    expect(entry).not_to_contain_text(UNFINISHED)


@pytest.mark.parametrize("way", ["look around", "export"])
def test_a_job_is_cancelled_after_a_reload(page, way):
    go_to(page, "#file=cube.off&lenses=500x500&pixels=9x9&show=mapped")
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 500, 500)
    if way == "export":
        page.locator("#format").select_option("all/mp4")
        page.get_by_role("button", name="Download").click()
    else:
        choose_mode(page, "Look around")
    entry = page.get_by_role("button", name=f"cube.off: {way}")
    expect(entry).to_contain_text(UNFINISHED)
    page.reload()
    expect(page.locator("#start")).to_be_visible()
    entry.click()
    expect(page.locator("#progress-text")).to_contain_text("views")
    with page.expect_response(lambda response: response.request.method == "DELETE") as deleted:
        page.get_by_role("button", name="Cancel").click()
    assert page.request.get(deleted.value.url).json()["state"] == "cancelled"
    expect(entry).to_have_count(0)
    expect(page.locator("#status")).to_have_text("Cancelled.")
    page.expected = ["404"]
    page.get_by_role("button", name="Try again").click()
    expect(page.get_by_role("alert")).to_contain_text("no longer has this job")


def test_the_list_asks_for_the_state_of_jobs_that_a_page_left(page):
    states = {"a": "done", "b": "failed", "c": "running", "d": "cancelled", "e": "gone"}
    page.expected = ["404"]

    def answer(route):
        state = states[route.request.url[-1]]
        route.fulfill(**({"status": 404} if state == "gone" else {"json": {"state": state}}))

    page.route(re.compile("/v1/reconstructions/.$"), answer)
    entries = [
        {"name": id_, "what": "Upscaled", "url": f"/v1/reconstructions/{id_}", "hash": "#", "state": "queued"}
        | {"details": [], "time": 0}
        for id_ in states
    ]
    page.evaluate("entries => localStorage.setItem('recent', JSON.stringify(entries))", entries)
    page.reload()
    listed = page.locator("#recent-list button span")
    expect(listed).to_have_text(["a: upscaled", "b: upscaled, failed", "c: upscaled, running"])


def test_a_recent_job_that_is_gone_is_reported_at_the_start_too(page):
    page.expected = ["404"]
    go_to(page, "#file=cube.off&lenses=20x20&pixels=3x3")  # one job
    choose(page, ("cube.off", CUBE))
    wait_for_picture(page, 40, 40)
    page.get_by_role("button", name="Another file").click()
    page.route("**/v1/reconstructions/*", lambda route: route.fulfill(status=404, json={"detail": "no such job"}))
    page.get_by_role("button", name="cube.off: upscaled").first.click()
    expect(page.get_by_role("alert")).to_contain_text("no longer has this job")
    expect(page.get_by_role("heading", name="cube.off")).to_be_visible()
    page.get_by_role("button", name="Another file").click()
    expect(page.get_by_role("heading", name="Look around")).to_be_visible()
    expect(page.locator("#recent")).to_be_hidden()  # the list no longer has it


@pytest.fixture
def posts(page):
    """The page's posts: the end of the path, and whether a file that was sent before is named."""
    found = []

    def keep(request):
        if request.method == "POST":
            found.append((request.url.rpartition("/")[2], 'name="file_id"' in (request.post_data or "")))

    page.on("request", keep)
    return found


def show_mapped_eia(page):
    go_to(page, "#file=eia.png&lenses=6x9&show=mapped")
    choose(page, ("eia.png", EIA_PNG))
    wait_for_picture(page, 6, 9)


def test_a_file_is_sent_once(page, posts):
    show_mapped_eia(page)
    choose_mode(page, "Look around")
    wait_for_rest(page)
    with page.expect_download():
        page.locator("#format").select_option("plane/png")
        page.get_by_role("button", name="Download").click()
    kinds = [kind for kind, _ in posts]
    assert kinds[:2] == ["files", "inspections"]
    assert {"reconstructions", "planes"} <= set(kinds[2:])
    assert [is_named for _, is_named in posts] == [False] + [True] * (len(posts) - 1)


@pytest.mark.parametrize("way", ["expired", "lost"])
def test_a_file_that_the_server_keeps_no_more_is_sent_again(page, posts, server, way):
    page.expected = ["410"]
    with page.expect_response("**/v1/files") as sent:
        show_mapped_eia(page)
    kept = f"{server}/v1/files/{sent.value.json()['id']}"
    posts.clear()
    if way == "expired":
        assert page.request.delete(kept).ok
    else:

        def answer(route):
            is_sent = "files" in [kind for kind, _ in posts]
            lost = {"status": 410, "json": {"detail": "file_id: no file is kept"}}
            return route.continue_() if is_sent else route.fulfill(**lost)

        page.route("**/v1/reconstructions", answer)
    set_field(page, "lenses", "12x18")
    wait_for_picture(page, 12, 18)
    kinds = [kind for kind, _ in posts]  # a job that a later one replaces may come first
    assert kinds[0] == "reconstructions"
    assert kinds[-2:] == ["files", "reconstructions"]
    assert kinds.count("files") == 1
    assert page.request.get(kept).ok
    page.unroute_all()
    posts.clear()
    set_field(page, "lenses", "6x9")
    choose_mode(page, "Upscaled")
    wait_for_picture(page, 12, 18)
    assert "files" not in [kind for kind, _ in posts]


@pytest.mark.parametrize(("limit", "status"), [(0, 413), (len(EIA_PNG), 503)])
def test_a_file_that_the_server_has_no_room_to_keep_is_sent_with_each_job(browser, tmp_path, limit, status):
    with serve_app(tmp_path, keep_bytes=limit) as server:
        if limit:
            httpx2.post(f"{server.url}/v1/files", files={"file": ("other.png", b"other")}).raise_for_status()
        page = browser.new_page()
        answers = []
        page.on("response", lambda each: answers.append((each.url.rpartition("/")[2], each.status)))
        page.goto(f"{server.url}#file=eia.png&lenses=6x9&show=mapped")
        choose(page, ("eia.png", EIA_PNG))
        wait_for_picture(page, 6, 9)
        posted = [(name, status) for name, status in answers if name in ("files", "inspections", "reconstructions")]
        assert posted == [("files", status), ("inspections", 202), ("files", status), ("reconstructions", 202)]
        page.close()


def test_a_file_over_the_limit_of_the_body_is_sent_once(browser, tmp_path):
    with serve_app(tmp_path, max_body_bytes=len(EIA_PNG)) as server:
        page = browser.new_page()
        answers = []
        page.on("response", lambda each: answers.append((each.url.rpartition("/")[2], each.status)))
        page.goto(f"{server.url}#file=eia.png&lenses=6x9&show=mapped")
        choose(page, ("eia.png", EIA_PNG))
        expect(page.get_by_role("alert")).to_contain_text("the request's body is over the limit")
        assert [each for each in answers if each[1] >= 400] == [("files", 413)]
        page.close()


def test_a_file_that_is_refused_again_is_reported(page, posts):
    page.expected = ["410"]
    page.route(
        "**/v1/reconstructions", lambda route: route.fulfill(status=410, json={"detail": "file_id: no file is kept"})
    )
    go_to(page, "#file=eia.png&lenses=6x9&show=mapped")
    choose(page, ("eia.png", EIA_PNG))
    expect(page.get_by_role("alert")).to_contain_text("file_id: no file is kept")
    assert [kind for kind, _ in posts] == ["files", "inspections", "reconstructions", "files", "reconstructions"]
