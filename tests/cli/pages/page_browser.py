# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Opens the page of `view --export` from a file in headless Chromium: its pictures against a rasteriser in Python,
its controls, and that nothing is loaded. `python3 page_browser.py PROGRAM RUN FOLDER`."""

import base64
import math
import os
import struct
import subprocess
import sys

from devtools import Browser, find_browser
from view_client import expect

program, run_folder, folder = sys.argv[1:4]


def ppm(path):
    """(width, height, RGB bytes) of a picture."""
    out = path + ".ppm"
    subprocess.run(["oiiotool", path, "--ch", "R,G,B", "-d", "uint8", "-o", out], check=True)
    with open(out, "rb") as file:
        magic, size, top, data = file.read().split(b"\n", 3)
    width, height = map(int, size.split())
    return width, height, data


def psnr(one, other):
    return 10 * math.log10(255 ** 2 * len(one) / max(1, sum((a - b) ** 2 for a, b in zip(one, other))))


def read_ply(path):
    """Rows of a binary PLY with float properties, as dictionaries."""
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + 11
    names = [line.split()[2] for line in data[:end].decode().split("\n") if line.startswith("property float")]
    return [dict(zip(names, row)) for row in struct.iter_unpack(f"<{len(names)}f", data[end:])]


def harmonics(degree, x, y, z):
    basis = [0.28209479177]
    if degree > 0:
        basis += [-0.4886025119 * y, 0.4886025119 * z, -0.4886025119 * x]
    if degree > 1:
        basis += [1.0925484306 * x * y, -1.0925484306 * y * z, 0.3153915653 * (2 * z * z - x * x - y * y),
                  -1.0925484306 * x * z, 0.5462742153 * (x * x - y * y)]
    if degree > 2:
        basis += [-0.5900435899 * y * (3 * x * x - y * y), 2.8906114426 * x * y * z, -0.4570457995 * y * (4 * z * z - x * x - y * y),
                  0.3731763326 * z * (2 * z * z - 3 * x * x - 3 * y * y), -0.4570457995 * x * (4 * z * z - x * x - y * y),
                  1.4453057213 * z * (x * x - y * y), -0.5900435899 * x * (x * x - 3 * y * y)]
    return basis


def rotation(w, x, y, z):
    n = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / n, x / n, y / n, z / n
    return ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))


def splat(row, lens, axes, eye, mip):
    """(distance, centre, covariance, opacity, colour) on the image plane: EWA splatting as in 3DGS, or None."""
    offset = [row[k] - e for k, e in zip("xyz", eye)]
    x, y, z = (sum(a * o for a, o in zip(axis, offset)) for axis in axes)
    if z <= lens["near"]:
        return None
    limit_x, limit_y = 0.65 * lens["width"] / lens["fx"], 0.65 * lens["height"] / lens["fy"]
    tx, ty = max(-limit_x, min(limit_x, x / z)), max(-limit_y, min(limit_y, y / z))
    jacobian = ((lens["fx"] / z, 0, -lens["fx"] * tx / z), (0, lens["fy"] / z, -lens["fy"] * ty / z))
    turn = rotation(*(row[f"rot_{k}"] for k in range(4)))
    scale = [math.exp(row[f"scale_{k}"]) for k in range(3)]
    world = [[sum(axes[i][j] * turn[j][k] for j in range(3)) * scale[k] for k in range(3)] for i in range(3)]
    u, v = ([sum(line[i] * world[i][k] for i in range(3)) for k in range(3)] for line in jacobian)
    a, b, c = sum(e * e for e in u), sum(e * f for e, f in zip(u, v)), sum(f * f for f in v)
    opacity, added = 1 / (1 + math.exp(-row["opacity"])), 0.1 if mip else 0.3
    if mip:
        opacity *= math.sqrt(max(0, a * c - b * b) / ((a + added) * (c + added) - b * b))
    far = math.sqrt(sum(o * o for o in offset))
    rest = sum(name.startswith("f_rest") for name in row) // 3
    basis = harmonics(round(math.sqrt(rest + 1)) - 1, *(o / far for o in offset))
    color = [max(0, 0.5 + basis[0] * row[f"f_dc_{k}"] + sum(basis[1 + j] * row[f"f_rest_{k * rest + j}"] for j in range(rest)))
             for k in range(3)]
    return far, (lens["fx"] * x / z + lens["cx"], lens["fy"] * y / z + lens["cy"]), (a + added, b, c + added), opacity, color


def srgb(value):
    """A linear value from 0 to 1, encoded (IEC 61966-2-1)."""
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055


def rasterise(rows, lens, axes, eye, mip, encode):
    """RGB bytes: splats in the order of the distances of their centres."""
    width, height = lens["width"], lens["height"]
    image, left = [0.0] * (3 * width * height), [1.0] * (width * height)
    for _, (x, y), (a, b, c), opacity, color in sorted(s for s in (splat(row, lens, axes, eye, mip) for row in rows) if s):
        if 255 * opacity <= 1:
            continue
        reach, det = math.sqrt(2 * math.log(255 * opacity)), a * c - b * b
        for py in range(max(0, int(y - reach * math.sqrt(c))), min(height, int(y + reach * math.sqrt(c)) + 2)):
            for px in range(max(0, int(x - reach * math.sqrt(a))), min(width, int(x + reach * math.sqrt(a)) + 2)):
                dx, dy = px + 0.5 - x, py + 0.5 - y
                alpha = min(0.99, opacity * math.exp(-0.5 * (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / det))
                if alpha >= 1 / 255:
                    at = py * width + px
                    for k in range(3):
                        image[3 * at + k] += left[at] * alpha * color[k]
                    left[at] *= 1 - alpha
    return bytes(round(255 * encode(max(0, min(1, value)))) for value in image)


def picture(page, name):
    """The canvas as a file; drawn and read in one task, because the drawing buffer is not kept."""
    text = page.run("(() => { page.draw(); return document.getElementById('picture').toDataURL(); })()")
    path = os.path.join(folder, name + ".png")
    with open(path, "wb") as file:
        file.write(base64.b64decode(text.split(",")[1]))
    return ppm(path)


def open_page(path, view, size):
    page = Browser(find_browser(), *size)
    page.open("file://" + os.path.abspath(path) + f"#camera={view}")
    expect("the_model_appears", page.wait("window.page && page.settled()", 60) is not None,
           page.run("document.getElementById('status').textContent"))
    return page


def compare(name, *options):
    """The page against a rasteriser of its own in double precision, at two cameras."""
    path, stored, model = (os.path.join(folder, name + ending) for ending in (".html", ".sog", ".ply"))
    for arguments in (("view", run_folder, *options, "--export", path), ("convert", run_folder, stored), ("convert", stored, model)):
        subprocess.run([program, *arguments, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    rows = read_ply(model)
    for view in (0, 3):
        page = open_page(path, view, (120, 67))
        shown = picture(page, f"{name}_{view}")
        camera = page.run("({...page.projection(), near: page.near(), axes: page.camera.axes, eye: page.camera.eye})")
        lens = {"width": shown[0], "height": shown[1], "near": camera["near"], "fx": camera["focal"][0], "fy": camera["focal"][1],
                "cx": camera["center"][0], "cy": camera["center"][1]}
        encode = srgb if "linear" in options else lambda value: value
        quality = psnr(shown[2], rasterise(rows, lens, camera["axes"], camera["eye"], "mip" in options, encode))
        print(f"{name}, camera {view}: {quality:.2f} dB")
        expect(f"{name}_{view}_is_right", quality > 40, quality)
        expect("no_message", not page.messages, page.messages)
        expect("nothing_is_loaded", all(r.startswith(("file:", "blob:")) for r in page.requests), page.requests)
        page.close()
    return path


def controls(path):
    page = open_page(path, 0, (480, 270))

    def changes(name, action):
        before = page.run("JSON.stringify([page.camera.eye, page.camera.axes])")
        pixels = picture(page, "before")[2]
        action()
        page.wait("page.settled()")
        expect(name, page.run("JSON.stringify([page.camera.eye, page.camera.axes])") != before and picture(page, "after")[2] != pixels)

    def drag(button, buttons, **more):
        page.mouse("mouseMoved", 200, 130)
        page.mouse("mousePressed", 200, 130, button, buttons, clickCount=1, **more)
        for k in range(1, 6):
            page.mouse("mouseMoved", 200 + 8 * k, 130 + 4 * k, button, buttons, **more)
        page.mouse("mouseReleased", 240, 150, button, 0, clickCount=1, **more)

    changes("dragging_orbits", lambda: drag("left", 1))
    changes("the_right_button_moves", lambda: drag("right", 2))
    changes("shift_moves", lambda: drag("left", 1, modifiers=8))
    changes("the_wheel_zooms", lambda: page.mouse("mouseWheel", 200, 130, deltaX=0, deltaY=240))
    for key in ("ArrowLeft", "ArrowUp", "+", "-", "w", "a", "s", "d", "q", "e"):
        changes("key_" + key, lambda: page.key(key))
    page.key("Home")
    first = page.run("JSON.stringify(page.camera.eye)")
    changes("next", lambda: page.run("document.getElementById('next').click()"))
    page.run("document.getElementById('previous').click()")
    expect("previous_goes_back", page.run("JSON.stringify(page.camera.eye)") == first)
    page.run("document.getElementById('info').click()")
    expect("help_opens", page.run("document.getElementById('help').offsetHeight > 0 && document.getElementById('info').ariaExpanded") == "true")
    page.screenshot(os.path.join(folder, "page.png"))
    page.key("Escape")
    expect("escape_closes_it", page.run("document.getElementById('help').hidden && document.getElementById('info').ariaExpanded") == "false")
    page.run("location.hash = 'camera=2'")
    expect("the_address_of_an_open_page_chooses_the_camera", page.wait("page.camera.number === 2") is not None)
    page.call("Emulation.setDeviceMetricsOverride", width=320, height=568, deviceScaleFactor=2, mobile=True)
    page.run("document.getElementById('status').textContent = 'a_long_name_of_a_model_'.repeat(4)")
    apart = page.run("document.querySelector('nav').getBoundingClientRect().left - document.getElementById('status').getBoundingClientRect().right")
    expect("the_text_leaves_the_buttons_free", apart >= 0, apart)
    expect("no_message_after_all", not page.messages, page.messages)
    page.close()


def lonely():
    """A model of one primitive is seen from outside, and can be moved around."""
    model = os.path.join(folder, "one.ply")
    source = next(os.path.join(at, n) for at, _, names in os.walk(run_folder) for n in names if n == "point_cloud.ply")
    with open(source, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + 11
    count = int(data[:end].split(b"element vertex ")[1].split()[0])
    with open(model, "wb") as file:
        file.write(data[:end].replace(b"element vertex %d" % count, b"element vertex 1") + data[end:end + (len(data) - end) // count])
    path = os.path.join(folder, "one.html")
    subprocess.run([program, "view", model, "--export", path, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    page = Browser(find_browser(), 400, 260)
    page.open("file://" + os.path.abspath(path))
    expect("one_primitive_is_drawn", page.wait("window.page && page.settled()") is not None and not page.messages, page.messages)
    eye, centre = page.run("page.camera.eye"), [read_ply(model)[0][k] for k in "xyz"]
    expect("it_is_seen_from_a_distance_of_1.5", abs(math.dist(eye, centre) - 1.5) < 0.01, math.dist(eye, centre))
    page.key("w")
    expect("keys_move_the_camera", math.dist(page.run("page.camera.eye"), eye) > 0.01)
    page.close()


def main():
    path = compare("page")
    controls(path)
    lonely()
    compare("mip", "--filter", "mip")
    compare("linear", "--train-space", "linear")
    sys.exit(1 if expect.failed else 0)


main()
