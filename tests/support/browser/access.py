"""Checks that everyone can use the page: axe-core, keyboard focus, and text at twice the size."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Page

AXE = (Path(__file__).parent / "vendor" / "axe-core-4.14.1" / "axe.min.js").read_text(encoding="utf-8")
WIDE, NARROW = {"width": 1280, "height": 800}, {"width": 320, "height": 640}
RUN = """async (rules) => (await axe.run(document, rules.length ? { runOnly: rules } : {})).violations.map(
    ({ id, nodes }) => [id, ...nodes.map(({ html }) => html)])"""
CONTROLS = "button, select, input, summary, [tabindex='0']"
LIST = f"""() => {{
    const groups = new Set();
    return [...document.querySelectorAll("{CONTROLS}")].filter((each) => {{
        if (!each.checkVisibility() || each.disabled) return false;
        if (each.type !== "radio") return true;
        return each.checked && groups.size < groups.add(each.name).size;
    }}).map((each, number) => (each.dataset.number = String(number)));
}}"""
FOCUSED = """() => {
    const { activeElement: each } = document, shown = [each, each.closest("label")].filter((part) => part);
    const isSeen = shown.some((part) => getComputedStyle(part).outlineStyle !== "none") || each.name === "divider";
    return [each.dataset.number, isSeen || each === document.body ? "" : each.outerHTML];
}"""
LAYOUT = """() => {
    const found = [], boxes = [];
    const { scrollWidth, clientWidth } = document.documentElement;
    if (scrollWidth > clientWidth) found.push(`the page is ${scrollWidth} pixels wide, the window ${clientWidth}`);
    const isSeen = (each) => each.checkVisibility({ opacityProperty: true }) && !each.closest(".unseen, option, svg");
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const node = walker.currentNode, range = document.createRange();
        if (!node.data.trim() || !isSeen(node.parentElement)) continue;
        range.selectNodeContents(node);
        for (const box of range.getClientRects()) boxes.push({ box, node, name: node.data.trim() });
    }
    const controls = "button:not(.handle), select, input:not([name=divider], [type=file])";
    for (const node of document.querySelectorAll(controls)) {
        const name = node.name || node.outerHTML;
        if (isSeen(node)) boxes.push({ box: node.getBoundingClientRect(), node, name });
    }
    for (const [index, { box, node, name }] of boxes.entries()) {
        for (let part = node.parentElement; part; part = part.parentElement) {
            const { left, right } = part.getBoundingClientRect();
            const isOutside = box.left < left - 1 || box.right > right + 1;
            if (isOutside && getComputedStyle(part).overflowX !== "visible") found.push(`${name} is cut off`);
        }
        for (const other of boxes.slice(0, index)) {
            if (node.contains(other.node) || other.node.contains(node)) continue;
            const wide = Math.min(box.right, other.box.right) - Math.max(box.left, other.box.left);
            const high = Math.min(box.bottom, other.box.bottom) - Math.max(box.top, other.box.top);
            if (wide > 2 && high > 4) found.push(`${name} lies on ${other.name}`);
        }
    }
    return found;
}"""


def check_access(page: Page) -> None:
    """Checks the page with axe, light and dark, for controls out of reach of the keyboard, for motion, and for layouts
    that larger text breaks. Fails with everything that it finds.
    """
    page.emulate_media(reduced_motion="reduce")
    found = {
        "light": run_axe(page),
        "keyboard": find_unreachable(page),
        "narrow": find_broken(page, NARROW),
        "large text": find_broken(page, WIDE, 200),
    }
    page.emulate_media(color_scheme="dark", reduced_motion="reduce")
    found["dark"] = run_axe(page, "color-contrast")
    found["motion"] = page.evaluate("document.getAnimations().map((each) => each.effect.target.outerHTML)")
    assert not any(found.values()), {name: each for name, each in found.items() if each}


def run_axe(page: Page, *rules: str) -> list[Any]:
    """Checks `rules` of axe, by default all. Returns those that the page breaks, with the elements that break them."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE)
    return page.evaluate(RUN, list(rules))  # type: ignore[no-any-return]


def find_unreachable(page: Page) -> list[str]:
    """Finds controls that the Tab key doesn't reach, and those whose focus is not visible."""
    wanted, found = set(page.evaluate(LIST)), []
    page.evaluate("document.activeElement.blur()")
    for _ in range(2 * len(wanted)):
        page.keyboard.press("Tab")
        number, unseen = page.evaluate(FOCUSED)
        wanted.discard(number)
        found += [f"no outline: {unseen}"] if unseen else []
        if not wanted:
            break
    return found + [page.locator(f"[data-number='{number}']").evaluate("each => each.outerHTML") for number in wanted]


def find_broken(page: Page, size: Any, percent: int = 100) -> list[str]:
    """Finds texts and controls that are cut off or overlap in a window of this size, and a page too wide for it."""
    before = page.viewport_size
    page.set_viewport_size(size)
    devtools = page.context.new_cdp_session(page)
    resize = "Page.setFontSizes"
    devtools.send(resize, {"fontSizes": {"standard": 16 * percent // 100, "fixed": 13 * percent // 100}})
    found = page.evaluate(LAYOUT)
    devtools.send(resize, {"fontSizes": {"standard": 16, "fixed": 13}})
    page.set_viewport_size(before or size)
    return found  # type: ignore[no-any-return]
