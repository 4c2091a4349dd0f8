# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Makes viewer.png, viewer-pixel.png and viewer-training.png in tools/manual/images anew, with headless Chromium.
`python3 tools/scripts/viewer_images.py PROGRAM RUN SCENE`, after
`sparegs train tests/data/room -o RUN --iterations 3000 --eval`. Pillow, if installed, reduces them to 256 colours."""

import os
import subprocess
import sys
import tempfile

try:
    from PIL import Image
except ImportError:
    Image = None

root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(root, "tests", "cli", "pages"))
from devtools import Browser, find_browser  # noqa: E402

program, run_folder, scene = sys.argv[1:4]
images = os.path.join(root, "tools", "manual", "images")
EXACT = "viewer.frame && viewer.frame.lossless && viewer.frame.serial === viewer.serial"


def require(condition, name):
    if condition is None:
        sys.exit(f"viewer_images: {name} did not appear")


def opened(*command):
    """A process that prints its address, and its page."""
    process = subprocess.Popen([program, *command], stdout=subprocess.PIPE, text=True)
    page = Browser(find_browser(), 1000, 600)
    page.open(process.stdout.readline().strip())
    require(page.wait("window.viewer && viewer.shown.length > 0", 60), "the first frame")
    return process, page


def show(page, *parts):
    page.run(f"document.querySelectorAll('#sections > details').forEach((part) => {{ part.open = {list(parts)}.includes(part.id); }})")


def finish(process, page, name):
    path = os.path.join(images, name)
    page.screenshot(path)
    if Image:
        Image.open(path).convert("RGB").quantize(256, method=Image.Quantize.MEDIANCUT).save(path, optimize=True)
    page.close()
    process.terminate()
    process.wait()


def stored(name, prepare):
    process, page = opened("view", run_folder, scene, "--port", "0", "--quiet")
    require(page.wait(EXACT, 60), "the exact frame")
    prepare(page)
    require(page.wait(EXACT, 60), "the exact frame")
    finish(process, page, name)


def depth(page):
    page.run("byId('aov').value = 'depth'; byId('aov').dispatchEvent(new Event('change'))")
    require(page.wait("viewer.frame.aov === 'depth' && " + EXACT, 60), "the depth")
    page.mouse("mouseMoved", 250, 280)
    require(page.wait("byId('value').textContent !== ''"), "the value")


def pixel(page):
    show(page, "pixelBox")
    page.click(285, 395)
    require(page.wait("viewer.region !== null"), "the list of the pixel")
    show(page, "pixelBox")


def training(page):
    """A paused training with the cameras of its scene."""
    require(page.wait("/Iteration [4-9][0-9][0-9] /.test(byId('runText').textContent)", 300), "iteration 400")
    page.run("byId('pause').click()")
    require(page.wait("/Paused/.test(byId('runText').textContent)", 60), "the pause")
    page.run("byId('frusta').click()")
    show(page, "runBox")
    require(page.wait("document.querySelectorAll('#plots svg').length > 0", 60), "the plots")
    require(page.wait(EXACT, 60), "the exact frame")


def trained():
    with tempfile.TemporaryDirectory() as folder:
        process, page = opened("train", scene, "-o", os.path.join(folder, "run"), "--eval", "--iterations", "3000", "--view", "0",
                               "--quiet")
        training(page)
        finish(process, page, "viewer-training.png")


trained()
stored("viewer.png", depth)
stored("viewer-pixel.png", pixel)
