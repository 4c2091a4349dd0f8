# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Operates every control of the viewer's page in headless Chromium and checks the effect on pixels, texts or files.
`python3 view_browser.py PROGRAM RUN SCENE FOLDER`; screenshots and files go to FOLDER."""

import base64
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import sys
import time

from devtools import Browser, find_browser
from view_client import expect

program, run_folder, scene, folder = sys.argv[1:5]


def serve(*arguments, port=0):
    process = subprocess.Popen([program, "view", *arguments, "--port", str(port), "--quiet"], stdout=subprocess.PIPE, text=True)
    return process, process.stdout.readline().strip()


def model_file():
    return next(os.path.join(at, n) for at, _, names in os.walk(run_folder) for n in names if n == "point_cloud.ply")


def render(name, *arguments):
    """The pixels of `render --format png` as (width, height, RGB bytes)."""
    out = os.path.join(folder, "render_" + name)
    subprocess.run([program, "render", run_folder, *arguments, "--format", "png", "--aov", "rgba", "-o", out, "--quiet"],
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    file = next(os.path.join(at, n) for at, _, names in os.walk(out) for n in names if n.endswith(".png"))
    pixels = os.path.join(folder, name + ".ppm")
    subprocess.run(["oiiotool", file, "-d", "uint8", "-o", pixels], check=True)
    with open(pixels, "rb") as data:
        return parse_ppm(data.read())


def parse_ppm(data):
    fields, at = [], 0
    while len(fields) < 4:
        end = at
        while data[end:end + 1] not in (b" ", b"\n"):
            end += 1
        if data[at:at + 1] != b"#":
            fields.append(data[at:end])
        at = end + 1
    return int(fields[1]), int(fields[2]), data[at:]


def lens_scene(name, model, focal, distortion):
    """Photos of the scene cut to 360 x 270 pixels, with a lens of COLMAP's model number `model`."""
    path = os.path.join(folder, name)
    os.makedirs(os.path.join(path, "images"), exist_ok=True)
    shutil.copytree(os.path.join(scene, "sparse"), os.path.join(path, "sparse"), dirs_exist_ok=True)
    words = ["oiiotool"]
    for photo in sorted(os.listdir(os.path.join(scene, "images"))):
        words += [os.path.join(scene, "images", photo), "--cut", "360x270+60+0", "-o", os.path.join(path, "images", photo), "--pop"]
    subprocess.run(words, check=True)
    params = [*focal, 181, 133, *distortion]
    with open(os.path.join(path, "sparse", "0", "cameras.bin"), "r+b") as file:
        identifier = struct.unpack("<QIiQQ", file.read(32))[1]
        file.seek(0)
        file.write(struct.pack(f"<QIiQQ{len(params)}d", 1, identifier, model, 360, 270, *params))
        file.truncate()
    return path


class Page(Browser):
    def start(self, url):
        self.open(url)
        expect("a_picture_appears", self.wait("window.viewer && viewer.shown.length > 0") is not None)
        self.rest()

    def rest(self):
        """Waits for the exact picture of the last request."""
        time.sleep(0.2)
        return self.wait("viewer.frame && viewer.frame.lossless && viewer.frame.serial === viewer.serial")

    def pixels(self):
        text = self.run("""(() => { const c = document.getElementById('picture');
            const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            const rgb = new Uint8Array(d.length / 4 * 3);
            for (let i = 0, k = 0; i < d.length; ++i) if (i % 4 !== 3) rgb[k++] = d[i];
            let text = ''; for (let i = 0; i < rgb.length; i += 8192) text += String.fromCharCode(...rgb.subarray(i, i + 8192));
            return c.width + ' ' + c.height + ' ' + btoa(text); })()""")
        width, height, data = text.split(" ")
        return int(width), int(height), base64.b64decode(data)

    def set(self, name, value, event="change"):
        self.run(f"""(() => {{ const e = document.getElementById('{name}');
            if (e.type === 'checkbox') e.checked = {json.dumps(value)}; else e.value = {json.dumps(str(value))};
            e.dispatchEvent(new Event('{event}', {{bubbles: true}})); }})()""")

    def press(self, name):
        self.run(f"document.getElementById('{name}').click()")

    def changes(self, name, action, back=None):
        """The action changes the picture; `back`, if given, restores it exactly."""
        before = self.pixels()
        action()
        self.rest()
        expect(name + "_changes_the_picture", self.pixels() != before)
        if back:
            back()
            self.rest()
            expect(name + "_is_undone", self.pixels() == before)

    def camera(self):
        return self.run("JSON.stringify([camera.position, camera.back, camera.up, camera.fov])")

    def moves(self, name, action):
        before = self.camera()
        action()
        self.rest()
        expect(name + "_moves_the_camera", self.camera() != before)

    def drag(self, dx, dy, button="left", modifiers=0):
        buttons = {"left": 1, "right": 2}[button]
        self.mouse("mouseMoved", 300, 300)
        self.mouse("mousePressed", 300, 300, button, buttons, clickCount=1, modifiers=modifiers)
        for k in range(1, 6):
            self.mouse("mouseMoved", 300 + dx * k / 5, 300 + dy * k / 5, button, buttons, modifiers=modifiers)
        self.mouse("mouseReleased", 300 + dx, 300 + dy, button, 0, clickCount=1, modifiers=modifiers)


def overlay_pixels(page):
    return page.run("""(() => { const c = document.getElementById('overlay');
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n; })()""")


def opens(page, url):
    start = time.monotonic()
    page.start(url)
    print(f"exact picture {time.monotonic() - start:.2f} s after opening")
    own = url.rstrip("/").split("//")[1]
    expect("no_request_to_other_hosts", all(own in address or address.startswith(("blob:", "data:")) for address in page.requests),
           page.requests)
    expect("no_error_on_the_console", not page.messages and not page.run("viewer.errors.length"), page.messages)
    page.screenshot(os.path.join(folder, "opened.png"))


def equals_render(page):
    page.set("size", "photo")
    page.press("home")
    page.rest()
    name = page.run("viewer.hello.views[0].name")
    expect("at_rest_the_view_equals_render", page.pixels() == render("view", scene, "--view", name))
    page.set("size", "window")
    page.rest()


def moving(page):
    before = page.run("viewer.shown.length")
    page.mouse("mouseMoved", 400, 400)
    page.mouse("mousePressed", 400, 400, "left", 1, clickCount=1)
    start, k = time.monotonic(), 0
    while time.monotonic() - start < 3:
        k += 1
        page.mouse("mouseMoved", 300 + k * 3 % 300, 380 + k % 40, "left", 1)
        time.sleep(0.012)
    count, seconds = page.run("viewer.shown.length") - before, time.monotonic() - start
    times = sorted(page.run(f"viewer.shown.slice({before}).map((e) => e[1]).filter(Number.isFinite)"))
    page.mouse("mouseReleased", 500, 400, "left", 0, clickCount=1)
    print(f"moving: {count / seconds:.1f} pictures/s, median latency {times[len(times) // 2]:.0f} ms")
    expect("dragging_shows_pictures", count > 5, count)
    page.rest()


def cameras(page):
    page.press("home")
    page.rest()
    page.moves("orbit", lambda: page.drag(60, 20))
    page.moves("pan_with_the_right_button", lambda: page.drag(40, 10, "right"))
    page.moves("pan_with_shift", lambda: page.drag(40, 10, modifiers=8))
    page.set("mode", "fly")
    where = page.run("JSON.stringify(camera.position)")
    page.moves("looking_around", lambda: page.drag(40, 10))
    expect("looking_around_stays_in_place",
           max(abs(a - b) for a, b in zip(json.loads(where), page.run("camera.position"))) < 1e-9)
    page.set("mode", "pan")
    page.moves("pan", lambda: page.drag(40, 10))
    page.set("mode", "orbit")
    page.set("lens", -1)
    page.press("home")
    page.set("lens", -1)
    page.rest()
    page.mouse("mouseMoved", 420, 380)
    page.wait("viewer.probe && viewer.probe.x === pixelAt({clientX: 420, clientY: 380})[0] && !probing")
    probe = page.run("viewer.probe")
    point = probe["position"]
    distance = "Math.hypot(...add(camera.position, %s, -1))" % json.dumps(point)
    before = page.run(distance)
    page.moves("wheel", lambda: page.mouse("mouseWheel", 420, 380, deltaX=0, deltaY=-120))
    expect("the_wheel_approaches_the_surface_under_the_cursor", abs(page.run(distance) / before - 2.718281828 ** -0.3) < 0.02,
           page.run(distance) / before)
    projected = page.run(f"project({json.dumps(point)})")
    expect("the_surface_stays_under_the_cursor", max(abs(projected[0] - probe["x"]), abs(projected[1] - probe["y"])) < 2, projected)
    page.press("home")
    page.rest()
    page.mouse("mouseMoved", 421, 381)
    page.wait("viewer.probe && viewer.probe.x === pixelAt({clientX: 421, clientY: 381})[0] && !probing")
    page.run("picture.dispatchEvent(new MouseEvent('dblclick', {clientX: 421, clientY: 381}))")
    expect("a_double_click_sets_the_target", page.run("camera.target.join() === viewer.probe.position.join()"))
    page.run("picture.focus()")
    for key in ("ArrowLeft", "ArrowUp", "+", "-", "w", "d", "e"):
        page.moves("key_" + key, lambda: (page.key(key), time.sleep(0.15)) if len(key) > 1 or key in "+-" else hold(page, key))
    page.moves("home_key", lambda: page.key("Home"))
    page.changes("field_of_view", lambda: page.set("fov", 80, "input"))
    expect("field_of_view_is_sent", page.run("request.message.fov") == 80)
    page.changes("lens_of_a_view", lambda: page.set("lens", 0))
    page.moves("up_axis", lambda: page.set("up", "x"))
    page.set("up", "cameras")
    page.run("camera.right = rotate(camera.right, camera.back, 0.3); moved()")
    page.moves("level_horizon", lambda: page.press("level"))
    expect("the_horizon_is_level", abs(page.run("dot(camera.right, worldUp)")) < 1e-9)
    page.set("frusta", True)
    expect("frusta_are_drawn", overlay_pixels(page) > 50)
    page.set("frusta", False)
    expect("frusta_are_removed", overlay_pixels(page) == 0)
    slow = page.run("targetDistance()")
    page.set("speed", 1, "input")
    expect("speed_is_set", page.run("Number(byId('speed').value)") == 1 and slow > 0)


def hold(page, key):
    page.call("Input.dispatchKeyEvent", type="keyDown", key=key, code="Key" + key.upper())
    time.sleep(0.25)
    page.call("Input.dispatchKeyEvent", type="keyUp", key=key, code="Key" + key.upper())


def aovs(page):
    page.press("home")
    page.rest()
    for name in page.run("viewer.hello.aovs.map((aov) => aov.name)"):
        if name != "rgba":
            page.changes("aov_" + name, lambda: page.set("aov", name), lambda: page.set("aov", "rgba"))
    page.set("aov", "depth")
    page.rest()
    expect("a_colour_bar_is_shown", page.run("!byId('bar').hidden && byId('low').textContent !== ''"))
    page.changes("logarithmic", lambda: page.set("log", True), lambda: page.set("log", False))
    page.changes("a_range", lambda: (page.set("rangeLow", 0.5), page.set("rangeHigh", 50)),
                 lambda: (page.set("rangeLow", ""), page.set("rangeHigh", "")))
    for low, high in ((3, ""), ("", 3), (5, 4)):
        page.set("rangeLow", low)
        page.set("rangeHigh", high)
        page.rest()
        expect("half_a_range_is_reported", page.run("byId('rangeText').textContent !== '' && byId('rangeLow').ariaInvalid === 'true' && "
                                                    "!('range' in request.message)"), (low, high))
    page.set("aov", "rgba")
    expect("colours_have_no_range", page.run("byId('rangeText').textContent") == "")
    page.set("aov", "depth")
    page.set("rangeHigh", "")
    page.set("rangeLow", "")
    page.rest()
    expect("no_range_is_right", page.run("byId('rangeText').textContent === '' && byId('rangeLow').ariaInvalid === 'false'"))
    page.mouse("mouseMoved", 250, 330)
    expect("the_value_under_the_cursor", page.wait("byId('value').textContent.includes('depth: ')") is not None)
    page.screenshot(os.path.join(folder, "depth.png"))
    page.set("log", True)
    page.set("rangeLow", 0)
    page.set("rangeHigh", 5)
    expect("a_logarithmic_range_from_0_is_not_used", page.rest() is not None and page.run("!('range' in request.message)"))
    expect("which_is_shown", page.run("byId('rangeText').textContent.includes('must be positive')"))
    page.set("aov", "rgba")
    expect("which_does_not_matter_to_colours", page.rest() is not None and page.run("viewer.frame.aov") == "rgba")
    for name, value in (("log", False), ("rangeLow", ""), ("rangeHigh", "")):
        page.set(name, value)
    page.rest()
    expect("integers_are_shown_in_full", page.run("[number(1234567, 6), number(15625), number(12345678.5), number(0.1234567)]")
           == ["1234567", "15625", "1.23e+7", "0.1235"])
    page.changes("samples", lambda: page.set("samples", 4), lambda: page.set("samples", 1))
    page.set("size", "1280x720")
    page.rest()
    expect("size_is_fixed", page.pixels()[:2] == (1280, 720))
    page.set("size", "window")
    page.rest()


def photos(page):
    page.run("byId('photosBox').open = true")
    count = page.run("document.querySelectorAll('#photos button').length")
    expect("photos_are_listed", count == page.run("viewer.hello.views.length"))
    expect("thumbnails_load", page.wait("[...document.querySelectorAll('#photos img')].slice(0, 3).every((i) => i.complete && i.naturalWidth > 0)")
           is not None)
    page.changes("another_photo", lambda: page.run("document.querySelectorAll('#photos button')[3].click()"))
    expect("its_camera_is_exact", page.run("request.message.view") == 3)
    expect("a_photo_that_is_not_compared_is_not_loaded", not page.run("photoReady || photo.hasAttribute('src')"))
    page.set("compare", "slider")
    page.wait("photoReady")
    expect("the_slider_shows_both", page.run("!photo.hidden && !byId('split').hidden && photo.style.clipPath.includes('50%')"))
    page.call("Emulation.setDeviceMetricsOverride", width=640, height=360, deviceScaleFactor=2, mobile=False)
    page.rest()
    expect("the_slider_can_be_reached", page.run("""(() => { const box = byId('split').getBoundingClientRect();
        const lines = ['status', 'value'].map((id) => byId(id).getBoundingClientRect());
        return document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2) === byId('split') &&
            lines.every((line) => !line.height || line.top >= box.bottom); })()"""))
    page.call("Emulation.setDeviceMetricsOverride", width=1200, height=760, deviceScaleFactor=1, mobile=False)
    page.rest()
    page.set("split", 20, "input")
    expect("the_boundary_moves", page.run("photo.style.clipPath.includes('80%')"))
    page.screenshot(os.path.join(folder, "slider.png"))
    page.set("compare", "photo")
    expect("the_photo_is_shown", page.run("!photo.hidden && photo.style.clipPath === 'none'"))
    page.set("compare", "difference")
    expect("the_difference_is_drawn", overlay_pixels(page) > 1000)
    bright = """(() => { const d = overlay.getContext('2d').getImageData(0, 0, overlay.width, overlay.height).data;
        let sum = 0; for (let i = 0; i < d.length; i += 4) sum += d[i] + d[i + 1] + d[i + 2]; return sum; })()"""
    first = page.run(bright)
    page.set("gain", 8, "input")
    expect("the_gain_brightens_it", page.run(bright) > 1.5 * first)
    page.set("compare", "render")
    expect("the_render_is_shown_again", overlay_pixels(page) == 0)
    page.run("photo.dispatchEvent(new Event('error'))")
    expect("a_missing_photo_is_reported", page.wait("byId('message').textContent.includes(viewer.hello.views[3].name)") is not None)


def pixels_and_regions(page):
    page.run("byId('value').textContent = 'a value'")
    page.press("home")
    expect("a_value_is_that_of_this_camera", page.run("byId('value').textContent") == "")
    page.rest()
    page.run("viewer.ray = null; viewer.region = null")
    page.click(430, 390)
    expect("a_click_explains_the_ray", page.wait("viewer.ray !== null") is not None)
    hits = page.run("viewer.ray")
    expect("the_table_has_a_row_per_primitive", page.run("byId('pixelTable').tBodies[0].rows.length") == hits["count"] > 0)
    expect("transmittance_is_plotted", page.run("byId('pixelPlot').querySelectorAll('polyline').length") == 1)
    expect("the_region_is_explained", page.wait("viewer.region !== null && viewer.region.updates.length > 0") is not None)
    expect("two_curves_have_a_legend", page.run("""(() => { const names = [...byId('regionPlot').querySelectorAll('tspan')];
        const lines = [...byId('regionPlot').querySelectorAll('polyline')];
        return names.length === 2 && names.every((name, k) => getComputedStyle(name).fill === getComputedStyle(lines[k]).stroke); })()"""))
    update = page.run("viewer.region.updates[viewer.region.updates.length - 1]")
    explained = json.loads(subprocess.run([program, "explain", run_folder, "--region", ",".join(map(str, update["center"])), "--json"],
                                          check=True, capture_output=True, text=True).stdout)["updates"]
    close = [abs(a - b) <= 1e-6 * (1 + abs(a)) for key, value in update.items()
             for a, b in zip(*([v if isinstance(v, list) else [v] for v in (value, explained[-1][key])]))]
    expect("the_region_is_that_of_explain", all(close) and update.keys() == explained[-1].keys(), (explained[-1], update))
    expect("the_updates_are_listed", page.run("byId('regionTable').tBodies[0].rows.length") == len(explained))
    expect("enter_chooses_the_middle", enter(page))
    page.screenshot(os.path.join(folder, "pixel.png"))


def enter(page):
    page.run("viewer.ray = null; picture.focus()")
    page.key("Enter")
    return page.wait("viewer.ray !== null && viewer.ray.x === request.width >> 1") is not None


def run_panel(page):
    page.run("byId('runBox').open = true")
    expect("four_curves", page.wait("document.querySelectorAll('#plots polyline').length === 4") is not None)
    expect("all_updates_are_marked", page.run("document.querySelectorAll('#plots .update').length === 4 * viewer.history.spare.iteration.length"))
    expect("equal_values_have_one_label", page.run("""(() => { const svg = shape('svg', {}, byId('plots'));
        plot(svg, 'primitives', [{x: [100, 200], y: [7987, 7987], name: 'count'}]);
        const texts = [...svg.querySelectorAll('text')].map((text) => text.textContent); svg.remove(); return texts.join(); })()""")
           == "primitives,7987,100,200")
    page.run("document.querySelector('#plots .update').dispatchEvent(new MouseEvent('click', {bubbles: true}))")
    expect("an_update_is_explained", page.run("byId('updateText').textContent.includes('rap pruned')"))
    page.run("document.querySelectorAll('#plots .update')[1].focus()")
    page.key(" ", "Space")
    kept = "[...document.querySelectorAll('#plots .chosen')].length === 4 && document.activeElement.dataset.x === " \
           "document.querySelector('#plots .chosen').dataset.x && byId('updateText').textContent.includes(document.activeElement.dataset.x)"
    expect("a_key_explains_an_update", page.run(kept))
    page.run("showHistory(viewer.history)")
    expect("it_remains_when_the_curves_are_drawn_again", page.run(kept))
    expect("options_are_listed", page.run("byId('options').rows.length") > 20)
    expect("phases_are_listed", page.run("byId('phases').querySelectorAll('tr').length") > 5)
    page.press("fold")
    expect("controls_fold", page.run("getComputedStyle(byId('sections')).display") == "none")
    page.press("fold")


def files(page):
    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=folder)
    page.press("home")
    page.rest()
    shown = page.pixels()
    page.press("screenshot")
    expect("a_screenshot_is_saved", page.wait("viewer.saved && viewer.saved.kind === 'png'") is not None)
    end = time.monotonic() + 10
    name = next((n for n in os.listdir(folder) if n.startswith(os.path.basename(run_folder)) and n.endswith(".png")), None)
    while not name and time.monotonic() < end:
        time.sleep(0.1)
        name = next((n for n in os.listdir(folder) if n.startswith(os.path.basename(run_folder)) and n.endswith(".png")), None)
    expect("the_screenshot_is_a_file", name is not None)
    if name:
        subprocess.run(["oiiotool", os.path.join(folder, name), "--ch", "R,G,B", "-d", "uint8", "-o", os.path.join(folder, "shot.ppm")], check=True)
        with open(os.path.join(folder, "shot.ppm"), "rb") as data:
            expect("the_screenshot_has_the_pixels", parse_ppm(data.read()) == shown)
    page.press("exr")
    expect("an_exr_is_saved", page.wait("viewer.saved && viewer.saved.kind === 'exr'") is not None)
    path = page.run("viewer.saved.path")
    shown = "byId('message').textContent.includes(viewer.saved.path)"
    page.run("createImageBitmap(picture).then((b) => showPicture(viewer.frame, b))")
    expect("its_path_is_shown_until_the_camera_moves", page.run(shown))
    expect("the_exr_has_all_aovs", b"slack.S" in open(path, "rb").read(4096), path)
    os.remove(path)
    page.press("keyAdd")
    page.run("document.querySelectorAll('#photos button')[5].click()")
    page.rest()
    expect("and_not_any_longer", page.run("byId('message').textContent") == "")
    page.press("keyAdd")
    page.run("document.querySelectorAll('#photos button')[9].click()")
    page.press("keyAdd")
    expect("key_frames_are_listed", page.run("byId('keys').children.length") == 3)
    page.set("pathSeconds", 0.5)
    page.set("pathFps", 6)
    page.moves("playing", lambda: (page.press("play"), time.sleep(1)))
    page.press("pathSave")
    path = os.path.join(folder, "camera_path.json")
    text = page.run("viewer.saved.text")
    with open(path, "w") as file:
        file.write(text)
    frames = json.loads(text)["camera_path"]
    expect("the_path_has_all_frames", len(frames) == 3)
    key = page.run("keys[1].matrix")
    expect("the_path_passes_the_key_frame", max(abs(a - b) for a, b in zip(frames[1]["camera_to_world"], key)) < 1e-6)
    subprocess.run([program, "render", run_folder, "--camera", path, "--size", "160x90", "-o", os.path.join(folder, "path"), "--quiet"],
                   check=True, stdout=subprocess.DEVNULL)
    expect("render_reads_the_path", len(os.listdir(os.path.join(folder, "path"))) == 3)
    page.run("byId('keys').querySelectorAll('button')[1].click()")
    expect("a_key_frame_is_removed", page.run("byId('keys').children.length") == 2)
    page.moves("a_key_frame_is_shown", lambda: page.run("byId('keys').querySelector('button').click()"))
    page.set("pathSeconds", "")
    page.press("play")
    time.sleep(0.3)
    expect("an_empty_duration_is_the_initial_one", page.run("playing > 0 && camera.position.every(Number.isFinite)"))
    page.run("byId('keys').querySelectorAll('button')[1].click()")
    time.sleep(0.3)
    expect("playing_ends_without_two_key_frames", page.run("!playing && byId('play').textContent === 'Play'") and not page.messages,
           page.messages)


def crop(page):
    page.set("up", "cameras")
    page.press("home")
    page.set("cropPreview", "off")
    page.rest()
    page.changes("cropping_by_opacity", lambda: page.set("cropOpacity", 0.3), lambda: page.set("cropPreview", "off"))
    page.set("cropPreview", "mark")
    page.rest()
    marked = page.pixels()
    page.set("cropPreview", "hide")
    page.rest()
    expect("hiding_differs_from_marking", page.pixels() != marked)
    page.set("boxOn", True)
    page.rest()
    removed = page.run("viewer.frame.removed")
    expect("the_box_removes_more", 0 < removed < page.run("viewer.frame.gaussians"), removed)
    expect("box_and_handles_are_drawn", overlay_pixels(page) > 100)
    handle = page.run("""(() => { const box = picture.getBoundingClientRect();
        const found = cropHandles().map((h) => project(h.point)).find((p) => p && p[0] > 20 && p[1] > 20 && p[0] < request.width - 20
            && p[1] < request.height - 20);
        return found && [box.left + found[0] * box.width / request.width, box.top + found[1] * box.height / request.height]; })()""")
    if handle:
        before = page.run("JSON.stringify(cropValues().box)") + page.camera()
        page.mouse("mouseMoved", *handle)
        page.mouse("mousePressed", *handle, "left", 1, clickCount=1)
        for k in range(1, 6):
            page.mouse("mouseMoved", handle[0] + 5 * k, handle[1] + 5 * k, "left", 1)
        page.mouse("mouseReleased", handle[0] + 25, handle[1] + 25, "left", 0, clickCount=1)
        page.rest()
        after = page.run("JSON.stringify(cropValues().box)")
        expect("a_handle_changes_the_box_only", after not in before and page.camera() in before)
    page.set("sphereOn", True)
    page.set("cropSize", 3)
    page.set("cropSlack", 0)
    page.rest()
    expect("slack_removes_primitives", page.run("viewer.frame.removed") > removed)
    radius = page.run("byId('sphere_radius').value")
    page.set("sphere_radius", "")
    page.rest()
    expect("an_incomplete_sphere_is_reported", page.run("byId('cropText').textContent.includes('requires four numbers')"))
    page.set("sphere_radius", radius)
    page.rest()
    expect("a_complete_one_is_not", "requires" not in page.run("byId('cropText').textContent"))
    page.set("cropFloaters", True)
    page.rest()
    page.screenshot(os.path.join(folder, "crop.png"))
    expect("more_filters_remove_more", page.run("viewer.frame.removed") >= removed)
    page.press("cropSave")
    expect("a_file_is_saved", page.wait("viewer.saved && viewer.saved.kind === 'crop'") is not None)
    saved, command = page.run("viewer.saved"), page.run("byId('cropCommand').textContent").split(" ")
    out = os.path.join(folder, "crop_by_command.ply")
    expect("the_command_names_the_model", command[:3] == ["sparegs", "convert", run_folder] and command[3] == "OUT.ply", command)
    subprocess.run([program, "convert", run_folder, out, *command[4:], "--quiet"], check=True, stdout=subprocess.DEVNULL)
    with open(saved["path"], "rb") as one, open(out, "rb") as other:
        expect("the_file_is_that_of_the_command", one.read() == other.read())
    os.remove(saved["path"])
    page.press("cropCopy")
    expect("the_command_is_copied_or_shown", page.wait("/Copied|Select the command/.test(byId('cropText').textContent)") is not None)
    page.run("Object.defineProperty(navigator, 'clipboard', {value: undefined})")  # http, not of this machine
    page.press("cropCopy")
    expect("without_clipboard_the_command_is_shown", page.wait("byId('cropText').textContent.startsWith('Select')") is not None)
    page.set("cropOpacity", 2)
    page.press("cropSave")
    expect("a_wrong_crop_is_refused", page.run("byId('message').textContent.includes('out of range') && byId('cropOpacity').ariaInvalid === 'true'"))
    expect("the_others_are_shown", page.rest() is not None)
    page.set("cropOpacity", 0)
    page.rest()
    expect("a_wrong_crop_is_not_saved", not os.path.exists(saved["path"]))
    tell = "((hello) => { listeners.hello.forEach((call) => call(hello)); return JSON.stringify(request.message); })"
    page.run(f"viewer.stored = viewer.hello; {tell}({{...viewer.stored, training: true}})")
    expect("a_training_at_the_same_address_is_not_cropped", page.run("byId('cropBox').hidden && cropValues().preview === 'off'"))
    page.run(f"{tell}(viewer.stored)")
    page.rest()
    page.set("cropPreview", "off")


def fixed_size(page):
    """Photos of 4:3 in pictures of 16:9."""
    process, url = serve(model_file(), lens_scene("pinhole", 1, (300, 300), ()))
    try:
        page.start(url)
        for mode in ("render", "slider", "difference", "photo"):
            page.set("compare", mode)
            if mode != "render":
                page.wait("photoReady")
            page.set("size", "1280x720")
            page.rest()
            expect("a_view_keeps_its_aspect: " + mode, page.pixels()[:2] == (960, 720), page.pixels()[:2])
        box = page.run("(() => { const b = photo.getBoundingClientRect(); return b.width / b.height; })()")
        expect("the_photo_is_not_stretched", abs(box - 4 / 3) < 0.01, box)
        page.set("compare", "render")
        page.run("fly(0, 0, 0.01)")
        page.rest()
        expect("other_cameras_have_the_fixed_size", page.pixels()[:2] == (1280, 720))
        page.set("size", "window")
    finally:
        process.kill()


# Lenses by COLMAP's names: parameters after those of the intrinsics. The last ones are strong.
LENSES = (("SIMPLE_PINHOLE", ()), ("PINHOLE", ()), ("SIMPLE_RADIAL", (-0.1,)), ("RADIAL", (-0.12, 0.03)),
          ("OPENCV", (-0.2, 0.05, 0.003, -0.002)), ("FULL_OPENCV", (0.2, -0.1, 0.001, 0.002, 0.02, 0.3, 0.05, -0.01)),
          ("FOV", (0.9,)), ("SIMPLE_RADIAL_FISHEYE", (0.05,)), ("RADIAL_FISHEYE", (0.04, -0.02)),
          ("OPENCV_FISHEYE", (0.03, -0.012, 0.004, -0.001)),
          ("THIN_PRISM_FISHEYE", (0.05, -0.02, 0.002, -0.001, 0.003, -0.001, 0.004, -0.003)))


def colmap_distortion(name, extra, point):
    """WorldToImage of COLMAP's camera_models.h without focal length and principal point, model by model."""
    u, v = point[0] / point[2], point[1] / point[2]
    if name.endswith("_FISHEYE"):
        r = math.hypot(u, v)
        u, v = (u * math.atan(r) / r, v * math.atan(r) / r) if r > 0 else (u, v)
    r2, uv = u * u + v * v, u * v
    if name.endswith("PINHOLE"):
        return u, v
    if name == "FOV":
        r = math.sqrt(r2)
        factor = math.atan(r * 2 * math.tan(extra[0] / 2)) / (r * extra[0]) if r > 0 else 1
        return u * factor, v * factor
    if name == "OPENCV_FISHEYE":
        radial = sum(k * r2 ** (i + 1) for i, k in enumerate(extra))
        return u + u * radial, v + v * radial
    if len(extra) < 3:
        radial = extra[0] * r2 + (extra[1] * r2 * r2 if len(extra) == 2 else 0)
        return u + u * radial, v + v * radial
    k1, k2, p1, p2 = extra[:4]
    radial = k1 * r2 + k2 * r2 * r2
    du, dv = 2 * p1 * uv + p2 * (r2 + 2 * u * u), 2 * p2 * uv + p1 * (r2 + 2 * v * v)
    if name == "FULL_OPENCV":
        k3, k4, k5, k6 = extra[4:]
        radial = (1 + radial + k3 * r2 ** 3) / (1 + k4 * r2 + k5 * r2 ** 2 + k6 * r2 ** 3) - 1
    elif name == "THIN_PRISM_FISHEYE":
        k3, k4, sx1, sy1 = extra[4:]
        radial += k3 * r2 ** 3 + k4 * r2 ** 4
        du, dv = du + sx1 * r2, dv + sy1 * r2
    return u + u * radial + du, v + v * radial + dv


def lenses(page):
    """The page's projection against COLMAP's formulas, its inversion against the projection."""
    points = [(x / 5, y / 5, z) for x in range(-4, 5) for y in range(-4, 5) for z in (0.9, 2.5)]
    for name, extra in LENSES:
        simple = name.startswith("SIMPLE") or name in ("RADIAL", "RADIAL_FISHEYE")
        view = {"lens": name, "fisheye": name.endswith("_FISHEYE"), "params": [300, 181, 133, *extra] if simple else [300, 310, 181, 133, *extra]}
        found = page.run(f"""(() => {{ const lens = lensOf({json.dumps(view)});
            return {json.dumps(points)}.map((p) => {{ const at = throughLens(lens, p), ray = at && unit(rayOfLens(lens, at)), to = unit(p);
                return at && [...at, norm(add(ray, to, -1))]; }}); }})()""")
        within = [(at, point) for at, point in zip(found, points) if at]
        expect("a_lens_has_a_domain: " + name, len(within) >= 0.8 * len(points), len(within))
        wrong = max(math.dist(at[:2], colmap_distortion(name, extra, point)) for at, point in within)
        expect("it_is_that_of_colmap: " + name, wrong < 1e-12, wrong)
        expect("its_rays_are_the_inverse: " + name, max(at[2] for at, _ in within) < 1e-7)
    # y = r - 0.5 r^3 decreases beyond the square root of 2/3; both halves of a fold must not be drawn.
    limit = page.run("makeLens('SIMPLE_RADIAL', false, [300, 181, 133, -0.5]).limit")
    expect("a_fold_ends_the_domain", abs(limit - math.sqrt(2 / 3)) < 1e-9, limit)


def overlays(page):
    """What is drawn over the pictures of a fisheye lens, against points that the program traced."""
    process, url = serve(model_file(), lens_scene("fisheye", 5, (150, 151), LENSES[9][1]))
    try:
        page.start(url)
        page.set("size", "photo")
        page.rest()
        checked = 0
        for x in range(20, 360, 53):
            for y in range(15, 270, 48):
                page.run(f"probing = false; viewer.probe = null; probe({x}, {y})")
                page.wait("viewer.probe !== null")
                if not page.run("viewer.probe.depth > 0"):
                    continue
                checked += 1
                found = page.run("project(viewer.probe.position)")
                off = found and math.dist(found, (x + 0.5, y + 0.5))
                if not (found and off < 0.02):
                    expect("a_traced_point_is_drawn_at_its_pixel", False, (x, y, found))
                turned = page.run(f"norm(add(unit(add(viewer.probe.position, camera.position, -1)), rayThrough({x}, {y}), -1))")
                if not turned < 1e-4:
                    expect("its_ray_passes_the_point", False, (x, y, turned))
        expect("points_were_traced", checked > 20, checked)
        page.set("cropPreview", "mark")
        page.set("sphereOn", True)
        start = page.run("""(() => { const to = add(camera.position, rayThrough(300, 60), targetDistance());
            ['x', 'y', 'z'].forEach((name, k) => { byId('sphere_' + name).value = to[k]; }); byId('sphere_radius').value = 0.01;
            cropChanged(); const box = picture.getBoundingClientRect(), at = project(to);
            return [box.left + at[0] * box.width / request.width, box.top + at[1] * box.height / request.height]; })()""")
        page.rest()
        page.mouse("mouseMoved", *start)
        page.mouse("mousePressed", *start, "left", 1, clickCount=1)
        for k in range(1, 11):
            page.mouse("mouseMoved", start[0] - 8 * k, start[1] + 6 * k, "left", 1)
        page.mouse("mouseReleased", start[0] - 80, start[1] + 60, "left", 0, clickCount=1)
        page.rest()
        end = page.run("""(() => { const box = picture.getBoundingClientRect(), at = project(cropValues().sphere.slice(0, 3));
            return [box.left + at[0] * box.width / request.width, box.top + at[1] * box.height / request.height]; })()""")
        expect("a_handle_follows_the_pointer", math.dist(end, (start[0] - 80, start[1] + 60)) < 2, (start, end))
        page.set("frusta", True)
        page.screenshot(os.path.join(folder, "fisheye.png"))
        page.set("frusta", False)
        page.set("cropPreview", "off")
        page.set("size", "window")
    finally:
        process.kill()


def survives(page, process, url):
    page.open(url)
    page.wait("window.viewer && viewer.shown.length > 0")
    process.send_signal(signal.SIGTERM)
    expect("a_server_with_pages_ends_with_status_0", process.wait(30) == 0)
    expect("the_page_reports_the_end", page.wait("!byId('notice').hidden") is not None)


def reconnects(page):
    """Servers that follow one another on one port, while the page stays open."""
    process, url = serve(run_folder, scene)
    port, few = url.strip("/").rsplit(":", 1)[1], os.path.join(folder, "few")
    os.makedirs(os.path.join(few, "images"), exist_ok=True)
    shutil.copytree(os.path.join(scene, "sparse"), os.path.join(few, "sparse"), dirs_exist_ok=True)
    for name in sorted(os.listdir(os.path.join(scene, "images")))[:2]:
        shutil.copy(os.path.join(scene, "images", name), os.path.join(few, "images"))

    def restart(*arguments):
        page.run("viewer.shown.length = 0")
        process.terminate()
        process.wait(30)
        expect("the_attempts_are_shown", page.wait("!byId('notice').hidden && byId('notice').textContent.includes('attempt')")
               is not None, page.run("byId('notice').textContent"))
        started = serve(*arguments, port=port)[0]
        expect("a_picture_appears_again", page.wait("viewer.shown.length > 0", 60) is not None, page.run("viewer.errors"))
        page.rest()
        expect("the_notice_disappears", page.run("byId('notice').hidden"))
        return started

    try:
        page.start(url)
        page.run("document.querySelectorAll('#photos button')[5].click()")
        page.set("boxOn", True)
        page.set("box_x", -1)
        page.rest()
        before = page.camera()
        process = restart(run_folder, scene)
        expect("the_same_model_keeps_the_camera", page.camera() == before and page.run("request.message.view") == 5)
        expect("it_keeps_the_photo", page.run("document.querySelectorAll('#photos button[aria-pressed=true]').length") == 1)
        expect("it_keeps_the_crop", page.run("cropValues().box[0]") == -1)
        page.run("retries = 30")
        expect("attempts_follow_at_most_every_10_s", page.run("retryDelay(30)") == 10000 and page.run("retryDelay(0)") <= 2000)
        process = restart(model_file(), few)
        expect("fewer_views_are_shown", page.run("document.querySelectorAll('#photos button').length") == 2)
        expect("the_camera_is_the_first_one", page.run("camera.view === 0 && camera.lens === 0 && request.message.view === 0"))
        expect("its_photo_is_pressed", page.run("document.querySelectorAll('#photos button')[0].ariaPressed") == "true")
        expect("the_crop_is_reset", page.run("cropValues().preview === 'off' && !cropValues().box && Number(byId('box_x').value) !== -1"))
        process = restart(model_file())
        expect("no_view_is_left", page.run("camera.view === -1 && camera.lens === -1 && byId('photosBox').hidden"))
        expect("no_error_after_all", not page.run("viewer.errors.length"), page.run("viewer.errors"))
        # The browser itself reports failed connections.
        expect("no_exception_after_all", not [m for m in page.messages if "WebSocket" not in m and "ERR_" not in m], page.messages)
    finally:
        process.kill()


def main():
    process, url = serve(run_folder, scene)
    page = Page(find_browser())
    try:
        opens(page, url)
        for part in (equals_render, moving, cameras, aovs, photos, pixels_and_regions, run_panel, files, crop):
            print("-- " + part.__name__)
            part(page)
        expect("still_no_error_on_the_console", not page.messages and not page.run("viewer.errors.length"),
               (page.messages, page.run("viewer.errors")))
        survives(page, process, url)
        reconnects(page)
        fixed_size(page)
        lenses(page)
        overlays(page)
    finally:
        page.close()
        process.kill()
    phone, free = Page(find_browser(), 390, 800), serve(model_file())
    try:
        phone.start(free[1])
        expect("a_model_without_scene_is_shown", len(set(phone.pixels()[2])) > 20)
        expect("the_phone_has_no_sideways_scrolling", phone.run("document.documentElement.scrollWidth") <= 390)
        phone.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        expect("dark_colours", phone.run("getComputedStyle(document.body).backgroundColor") == "rgb(28, 31, 36)")
        phone.call("Emulation.setTouchEmulationEnabled", enabled=True)
        small = phone.run("""[...document.querySelectorAll('#panel button, #panel select, #panel input')].filter((e) => e.offsetHeight &&
            e.offsetHeight < (e.type === 'checkbox' ? 20 : 38)).map((e) => e.id)""")
        expect("controls_are_large_enough_for_fingers", phone.run("matchMedia('(pointer: coarse)').matches") and small == [], small)
        phone.screenshot(os.path.join(folder, "phone.png"))
        unnamed = phone.run("""[...document.querySelectorAll('button, input, select, canvas[tabindex]')].filter((e) =>
            !(e.textContent.trim() || e.getAttribute('aria-label') || (e.labels && e.labels.length))).map((e) => e.id)""")
        expect("every_control_has_a_name", unnamed == [], unnamed)
        expect("nothing_to_compare", phone.run("byId('compare').disabled"))
        phone.run("listeners.hello.forEach((call) => call({...viewer.hello, views: [{...%s, name: 'DSC_0001_'.repeat(20)}]}))" % json.dumps(
            {"width": 4, "height": 3, "fov": 50, "lens": "PINHOLE", "intrinsics": [4, 4, 2, 1.5], "params": [4, 4, 2, 1.5],
             "photo": False, "test": False, "fisheye": False, "camera_to_world": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}))
        phone.run("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        wide = phone.run("[byId('panel').scrollWidth, byId('panel').clientWidth]")
        expect("long_names_do_not_widen_the_panel", wide[0] <= wide[1], wide)
    finally:
        phone.close()
        free[0].terminate()
        free[0].wait()
    sys.exit(1 if expect.failed else 0)


main()
