"""What the page works on: progress, Cancel and errors are in sight; all ends once something else is chosen."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import needs_browser
from tests.support.browser.page import (
    SMALL,
    check_progress,
    choose,
    choose_mode,
    go_to,
    hold_posts,
    open_scene,
    set_field,
    wait_for_picture,
    wait_for_rest,
)
from tests.support.inputs import CUBE

pytestmark = [needs_browser, pytest.mark.slow]
PHONE, LAPTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 720}
NO_STORAGE = """() => Object.defineProperty(window, "sessionStorage", {
    get: () => { throw new DOMException("denied", "SecurityError"); },
})"""
HOLD = """(path) => {
    const names = path.split("."), name = names.pop();
    const owner = names.reduce((each, part) => each[part], window), before = owner[name];
    window.held = [];
    owner[name] = async function (...args) {
        const result = await before.apply(this, args);
        if (window.held) await new Promise((resume) => held.push(resume));
        return result;
    };
    window.resume = () => { for (const each of held) each(); window.held = null; };
}"""
CONTEXTS = """() => {
    const before = HTMLCanvasElement.prototype.getContext;
    window.contexts = new Set();
    HTMLCanvasElement.prototype.getContext = function (kind, ...args) {
        const context = before.call(this, kind, ...args);
        if (kind === "webgl2") contexts.add(context);
        return context;
    };
}"""
LIVE = "live => contexts.size > 0 && live === [...contexts].filter((each) => !each.isContextLost()).length"


@pytest.fixture
def posted(page):
    """The forms that the page posts, as dictionaries."""
    forms = []

    def keep(request):
        if request.method == "POST":
            forms.append(dict(re.findall(r'name="(\w+)"\r\n\r\n(.*)\r', request.post_data or "")))

    page.on("request", keep)
    return forms


def hold(page, path):
    """Holds the results of a function of the browser back until `resume`."""
    page.evaluate(HOLD, path)


def wait_until_held(page):
    page.wait_for_function("() => held.length > 0")


def wait_for_contexts(page, live):
    """Waits until so many of the contexts are live; there was at least one."""
    page.wait_for_function(LIVE, arg=live)


def wait_for_upscaled_views(page):
    page.get_by_role("checkbox", name="Disparity").wait_for()


def test_a_light_field_that_is_left_while_it_loads_begins_no_job(page, posted):
    go_to(page, f"{SMALL}&show=mapped")
    wait_for_picture(page, 20, 30)
    hold(page, "createImageBitmap")
    choose_mode(page, "Look around")
    wait_until_held(page)
    choose_mode(page, "As mapped")
    expect(page.locator("#status")).to_contain_text("Done in")
    posted.clear()
    page.evaluate("resume()")
    choose_mode(page, "Look around")
    wait_for_upscaled_views(page)
    expect(page.locator("#frame canvas")).to_be_visible()
    assert [form.get("model") for form in posted] == ["none", "auto"]


@pytest.mark.parametrize("way", ["close", "bad file", "other mode"])
def test_a_light_field_is_closed_when_it_is_left(page, way):
    page.expected = ["415"]
    page.evaluate(CONTEXTS)
    go_to(page, f"{SMALL}&show=around")
    wait_for_upscaled_views(page)
    page.get_by_role("checkbox", name="Tour").check()
    wait_for_contexts(page, 1)
    if way == "close":
        page.get_by_role("button", name="Another file").click()
    elif way == "bad file":
        choose(page, ("a.obj", b"hello\n"))
    else:
        choose_mode(page, "As mapped")
    wait_for_contexts(page, 0)


def test_a_light_field_that_is_left_while_it_loads_is_closed(page):
    page.evaluate(CONTEXTS)
    hold(page, "createImageBitmap")
    go_to(page, f"{SMALL}&show=around")
    wait_until_held(page)
    page.get_by_role("button", name="Another file").click()
    page.evaluate("resume()")
    wait_for_contexts(page, 0)
    expect(page.locator("#start")).to_be_visible()


def test_one_light_field_is_open_after_many_are_reopened(page):
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    for name, value in (("lenses", "20x20"), ("pixels", "3x3")):
        set_field(page, name, value)
    wait_for_picture(page, 40, 40)
    choose_mode(page, "Look around")
    wait_for_upscaled_views(page)
    page.evaluate(CONTEXTS)
    for count in (1, 2, 3):
        page.get_by_role("button", name="cube.off: look around").click()
        page.wait_for_function("count => contexts.size === count", arg=count)
        expect(page.locator("#status")).to_contain_text("Done in")
    wait_for_contexts(page, 1)


@pytest.mark.parametrize("way", ["closed", "another"])
def test_files_that_are_being_packed_are_given_up(page, posted, way):
    hold(page, "Blob.prototype.arrayBuffer")
    choose(page, ("a.off", CUBE), ("b.off", CUBE))
    wait_until_held(page)
    page.get_by_role("button", name="Another file").click()
    if way == "another":
        open_scene(page)
    page.evaluate("resume()")
    if way == "closed":
        expect(page.locator("#start")).to_be_visible()
        open_scene(page)
    expect(page.locator("#status")).to_contain_text("Done in")
    expect(page.get_by_role("heading", level=1, name="Vase")).to_be_visible()
    assert {form.get("scene") for form in posted} == {"vase"}


def test_back_leads_to_what_was_shown_before(page):
    page.get_by_role("link", name="Globe").click()
    expect(page.locator("#frame img, #frame canvas")).to_be_visible()
    choose(page, ("cube.off", CUBE))
    expect(page.locator("#kind")).to_have_text("A mesh")
    page.go_back()
    expect(page.get_by_role("heading", level=1, name="Globe")).to_be_visible()
    page.go_back()
    expect(page.locator("#start")).to_be_visible()
    assert "#" not in page.url


@pytest.mark.parametrize("size", [PHONE, LAPTOP])
def test_progress_is_in_sight_and_a_picture_stays_until_the_next_is_made(page, size):
    page.set_viewport_size(size)
    go_to(page, f"{SMALL}&show=mapped")
    wait_for_picture(page, 20, 30)
    hold_posts(page, "reconstructions", "views")
    for mode in ("Look around", "Compare"):
        page.get_by_role("radio", name=mode).check()
        check_progress(page)
        expect(page.locator("#frame > img")).to_be_visible()
        if mode == "Look around":
            page.unroute_all()
            hold_posts(page, "reconstructions", "strategy")  # the truth


def test_what_was_cancelled_is_begun_again(page):
    hold_posts(page, "reconstructions", "views")
    go_to(page, f"{SMALL}&show=around")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#status")).to_have_text("Cancelled.")
    again = page.get_by_role("button", name="Try again")
    expect(again).to_be_in_viewport()
    page.unroute_all()
    again.click()
    page.get_by_role("checkbox", name="Disparity").wait_for()
    expect(again).to_be_hidden()


def test_a_job_is_begun_again_after_it_was_cancelled(page, posted):
    """The same input and options are the same job of the server: begun before, it would be the one that is removed."""
    deleted = []
    page.route("**/events", lambda route: None)  # the job does not end
    page.route(
        "**/v1/reconstructions/*",
        lambda route: deleted.append(route) if route.request.method == "DELETE" else route.fallback(),
    )
    with page.expect_request("**/events"):
        go_to(page, "#scene=vase&lenses=21x31&pixels=5x5")  # that no other test has made
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Try again").click()
    check_progress(page)
    assert len(posted) == 1
    page.unroute("**/events")
    [route] = deleted
    route.continue_()
    wait_for_picture(page, 42, 62)


@pytest.mark.parametrize("way", ["left", "left when done", "left and begun again"])
def test_a_job_that_is_left_soon_is_ended_unless_it_is_done_or_wanted_again(page, way):
    address = "#scene=vase&lenses=23x31&pixels=5x5"  # that no other test has made
    go_to(page, f"{address}&show=mapped")
    wait_for_picture(page, 23, 31)
    status, asked = {"id": "a", "state": "running", "progress": None}, []

    def answer(route):
        asked.append(route.request.method)
        route.fulfill(json=status | ({"state": "done"} if way == "left when done" else {}))

    page.route(
        "**/v1/reconstructions",
        lambda route: route.fulfill(json=status) if "auto" in route.request.post_data else route.fallback(),
    )
    page.route("**/v1/reconstructions/a/events", lambda route: None)
    page.route("**/v1/reconstructions/a", answer)
    with page.expect_request("**/a/events"):
        choose_mode(page, "Upscaled")
    choose_mode(page, "As mapped")
    if way == "left and begun again":
        with page.expect_request("**/a/events"):
            choose_mode(page, "Upscaled")
    page.wait_for_timeout(4000)  # longer than a job that is left may run on
    assert asked == {"left": ["GET", "DELETE"], "left when done": ["GET"], "left and begun again": []}[way]


def test_a_cancelled_disparity_is_reported_in_plain_words(page):
    go_to(page, f"{SMALL}&show=around")
    box = page.get_by_role("checkbox", name="Disparity")
    hold_posts(page, "disparities")
    box.wait_for()
    wait_for_rest(page)  # the line then has the viewpoint
    box.check()
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".light-field [role=status]")).to_have_text("Cancelled.")
    assert not box.is_checked()


@pytest.mark.parametrize("size", [PHONE, LAPTOP])
def test_progress_and_errors_of_a_download_are_in_sight(page, size):
    page.expected = ["422"]
    page.set_viewport_size(size)
    open_scene(page)
    page.locator("#format").select_option("stack/gif")
    page.locator("#export-form [name=stack]").fill("bla")
    page.get_by_role("button", name="Download").click()
    field, button = page.locator("[name=stack]"), page.get_by_role("button", name="Download")
    alert = page.get_by_role("alert")
    for part in (alert, button):
        expect(part).to_be_in_viewport(ratio=1)
    expect(field).to_have_attribute("aria-invalid", "true")
    field.fill("-1:1:4")  # that one mends it is in sight, too
    expect(alert).to_be_hidden()
    expect(field).not_to_have_attribute("aria-invalid", "true")
    hold_posts(page, "planes")
    button.click()
    check_progress(page)
    expect(button).to_be_in_viewport(ratio=1)
    set_field(page, "lenses", "bla")
    expect(alert).to_contain_text("lenses")
    expect(page.locator(".stage").get_by_role("alert")).to_be_in_viewport(ratio=1)
    page.unroute_all()
    set_field(page, "lenses", "20x30")
    choose_mode(page, "As mapped")
    hold_posts(page, "reconstructions")
    set_field(page, "lenses", "22x30")
    check_progress(page)
    expect(page.locator(".stage progress")).to_be_visible()


def test_the_page_works_where_the_browser_refuses_storage(page):
    page.add_init_script(f"({NO_STORAGE})()")
    go_to(page, SMALL)
    page.reload()
    wait_for_picture(page, 40, 60)
    expect(page.get_by_role("button", name="Vase: upscaled")).to_be_visible()


def test_done_is_said_once_all_is_shown(page):
    go_to(page, f"{SMALL}&show=mapped")
    status = page.locator("#status")
    expect(status).to_contain_text("Done in")
    page.get_by_role("radio", name="Upscaled").check()
    wait_for_picture(page, 40, 60)
    page.get_by_role("radio", name="As mapped").check()
    wait_for_picture(page, 20, 30)  # it was made before
    expect(status).to_have_text(re.compile(r"^Done in \d+ ms$"))
    page.route("**/v1/reconstructions", lambda route: None if "auto" in route.request.post_data else route.fallback())
    page.get_by_role("radio", name="Look around").check()
    wait_for_rest(page)
    expect(status).to_have_text("Look around")  # the views are being upscaled


def test_the_notes_of_a_report_are_in_sight_in_each_view(page):
    go_to(page, "#file=cube.obj&lenses=20x20&pixels=3x3&show=mapped")
    choose(page, ("cube.obj", b"mtllib gone.mtl\nv -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n"))
    note = page.locator("#notes p")
    shown = {"As mapped": "20 x 20", "Upscaled": "40 x 40", "Look around": "Disparity", "Compare": "Zoom"}
    for mode, text in [*shown.items(), ("As mapped", "20 x 20")]:  # the last was made before
        choose_mode(page, mode)
        expect(page.locator(".stage")).to_contain_text(text)
        expect(page.locator("#status")).to_contain_text("Done in")
        expect(note).to_contain_text(["gone.mtl"])  # once, though several jobs have it
    expect(page.locator("#notes")).to_have_role("status")
    go_to(page, SMALL)
    wait_for_picture(page, 40, 60)
    expect(note).to_have_count(0)


def test_what_a_display_shows_is_counted_in_percent(page):
    """Its progress counts rows of pixels."""
    open_scene(page)
    progress = {"stage": "render", "views_done": 172, "views": 1600}
    status = {"id": "a", "state": "running", "progress": progress}
    page.route("**/v1/displays", lambda route: route.fulfill(json=status))
    page.route("**/v1/displays/a/events", lambda route: None)
    page.locator("#format").select_option("displays/quilt")
    page.get_by_role("button", name="Download").click()
    expect(page.locator("#progress-text")).to_contain_text("Rendering, 10 %")


def test_a_picture_without_a_network_is_called_mapped(page):
    go_to(page, f"{SMALL}&model=none&show=upscaled")
    wait_for_picture(page, 20, 30)
    expect(page.locator("#status")).to_contain_text("Done in")
    expect(page.locator("#caption")).to_have_text("As mapped, 30 x 20 pixels")
