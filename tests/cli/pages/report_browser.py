# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Opens a page of `report` in headless Chromium: names of controls, narrow windows, long names, empty parts, printing.
`python3 report_browser.py PAGE FOLDER`; changed pages go to FOLDER."""

import json
import os
import sys

from devtools import Browser, find_browser
from view_client import expect

source, folder = sys.argv[1:3]
BEGIN, END = '<script type="application/json" id="data">', "</script>"


def changed(name, change):
    """The page with other data."""
    with open(source, encoding="utf-8") as file:
        text = file.read()
    begin = text.index(BEGIN) + len(BEGIN)
    end = text.index(END, begin)
    data = json.loads(text[begin:end])
    change(data)
    path = os.path.join(folder, name + ".html")
    with open(path, "w", encoding="utf-8") as file:
        file.write(text[:begin] + json.dumps(data).replace("<", "\\u003c") + text[end:])
    return path


def lengthen(data):
    for run in data["runs"]:
        run["scene"], run["pipeline"], run["variant"] = "a_scene_" * 6, run["pipeline"] + "_with_a_long_name" * 2, "a variant of it " * 2
        run["seconds"].update({f"phase_{k}_of_the_long_ones": 1.0 for k in range(12)})
    for picture in data["pictures"]:
        picture["label"] = "a_long_label_" * 12


def empty(data):
    data["pictures"] = []
    for run in data["runs"]:
        run["regions"] = []


def opened(page, path):
    page.open("file://" + os.path.abspath(path))
    expect("the_page_is_drawn", page.wait("document.documentElement?.dataset.drawn > 0") is not None)


def fits(page, name):
    wide = page.run("document.documentElement.scrollWidth")
    expect("no_sideways_scrolling: " + name, wide <= page.run("innerWidth"), wide)
    cut = page.run("""[...document.querySelectorAll('#seconds text')].filter((text) => {
        const box = text.getBBox(), view = text.ownerSVGElement.viewBox.baseVal;
        return !text.hasAttribute('transform') && (box.x < 0 || box.x + box.width > view.width || box.y + box.height > view.height);
    }).map((text) => text.textContent)""")
    expect("no_text_is_cut: " + name, cut == [], cut)


def main():
    page = Browser(find_browser(), 390, 844)
    try:
        opened(page, source)
        fits(page, "phone")
        unnamed = page.run("""[...document.querySelectorAll('select, input, svg')].filter((e) =>
            !(e.getAttribute('aria-label') || (e.labels && e.labels.length))).map((e) => e.id || e.tagName)""")
        expect("everything_has_a_name", unnamed == [], unnamed)
        expect("images_have_a_text", page.run("[...document.querySelectorAll('#compare img')].map((i) => i.alt)") == ["Photo", "Render"])
        expect("tables_have_heads", page.run("""[...document.querySelectorAll('#tables table')].every((table) => table.tHead &&
            table.tHead.rows.length === 1 && table.tBodies[0].rows.length > 0)"""))
        page.call("Emulation.setEmulatedMedia", media="print")
        expect("the_log_is_printed_whole", page.run("getComputedStyle(document.getElementById('log')).maxHeight") == "none")
        page.call("Emulation.setDeviceMetricsOverride", width=1000, height=700, deviceScaleFactor=1, mobile=False)
        wide = page.run("[...document.querySelectorAll('#tables table')].map((table) => table.offsetWidth - table.parentNode.clientWidth)")
        expect("tables_fit_on_a_page_across", all(w <= 0 for w in wide), wide)
        page.call("Emulation.setEmulatedMedia", media="")
        page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=False)
        opened(page, changed("long", lengthen))
        fits(page, "long names")
        opened(page, changed("empty", empty))
        shown = page.run("[...document.querySelectorAll('h2')].filter((h) => h.offsetHeight).map((h) => h.textContent)")
        expect("empty_parts_are_hidden", "Regions" not in shown and "Renders and photos" not in shown and "Tables" in shown, shown)
        expect("no_message", not page.messages, page.messages)
    finally:
        page.close()
    sys.exit(1 if expect.failed else 0)


main()
