# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Drives a headless Chromium over its DevTools protocol."""

import base64
import json
import os
import re
import subprocess
import tempfile
import time

from websocket_client import WebSocket


class Browser:
    """A page in a new browser; `messages` collects the text of its console and exceptions, `requests` the addresses."""

    def __init__(self, program, width=1200, height=760):
        self.profile = tempfile.TemporaryDirectory()
        self.process = subprocess.Popen(
            [program, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run",
             f"--user-data-dir={self.profile.name}", f"--window-size={width},{height}", "--hide-scrollbars",
             "about:blank"], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        port = None
        for line in self.process.stderr:
            found = re.search(r"DevTools listening on ws://[^:]*:(\d+)", line)
            if found:
                port = int(found.group(1))
                break
        self.port, self.number = port, 0
        self.messages, self.requests = [], []
        browser = WebSocket("127.0.0.1", port, re.search(r"(/devtools/\S+)", line).group(1))
        browser.send({"id": 1, "method": "Target.getTargets"})
        while True:
            reply = json.loads(browser.receive())
            if reply.get("id") == 1:
                break
        target = next(t for t in reply["result"]["targetInfos"] if t["type"] == "page")
        browser.close()
        self.link = WebSocket("127.0.0.1", port, "/devtools/page/" + target["targetId"])
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(domain + ".enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def _event(self, message):
        method, given = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.messages.append(given["exceptionDetails"].get("exception", {}).get("description", "exception"))
        elif method == "Runtime.consoleAPICalled" and given["type"] in ("error", "warning"):
            self.messages.append(json.dumps(given["args"]))
        elif method == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.messages.append(given["entry"]["text"] + " " + given["entry"].get("url", ""))
        elif method == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(given["url"])
        elif method == "Page.javascriptDialogOpening":
            self.number += 1
            self.link.send({"id": self.number, "method": "Page.handleJavaScriptDialog", "params": {"accept": True}})

    def call(self, method, **given):
        self.number += 1
        number = self.number
        self.link.send({"id": number, "method": method, "params": given})
        while True:
            message = json.loads(self.link.receive())
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(method + ": " + str(message["error"]))
                return message["result"]
            self._event(message)

    def open(self, url):
        self.call("Page.navigate", url=url)

    def run(self, script):
        """The value of a JavaScript expression; promises are awaited."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            raise RuntimeError(script + ": " + json.dumps(result["exceptionDetails"])[:500])
        return result["result"].get("value")

    def wait(self, condition, seconds=30):
        """Until the expression is true; returns the seconds that it took, None if it stayed false."""
        start = time.monotonic()
        while time.monotonic() - start < seconds:
            if self.run(condition):
                return time.monotonic() - start
            time.sleep(0.02)
        return None

    def mouse(self, kind, x, y, button="none", buttons=0, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, **more)

    def click(self, x, y, count=1):
        self.mouse("mouseMoved", x, y)
        for k in range(count):
            self.mouse("mousePressed", x, y, "left", 1, clickCount=k + 1)
            self.mouse("mouseReleased", x, y, "left", 0, clickCount=k + 1)

    def key(self, key, code=None):
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=code or key)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=code or key)

    def screenshot(self, path):
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        with open(path, "wb") as file:
            file.write(data)

    def close(self):
        self.link.close()
        self.process.terminate()
        self.process.wait()
        self.process.stderr.close()
        try:
            self.profile.cleanup()
        except OSError:
            pass  # the browser's helpers may still write


def find_browser():
    for name in ("chromium", "chromium-browser", "google-chrome"):
        for folder in os.environ.get("PATH", "").split(":"):
            if os.access(os.path.join(folder, name), os.X_OK):
                return os.path.join(folder, name)
    return None
