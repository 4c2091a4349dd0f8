# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""A page of the viewer without a browser. `python3 view_client.py URL COMMAND ...` for the shell tests; see main()."""

import json
import os
import random
import socket
import struct
import sys
import threading
import time
from urllib.parse import urlparse
from urllib.request import urlopen

from websocket_client import Closed, WebSocket


class Page:
    """Collects messages; pictures are acknowledged unless `silent`."""

    def __init__(self, url, **more):
        address = urlparse(url)
        path = "/stream" + ("?" + address.query if address.query else "")
        self.socket = WebSocket(address.hostname, address.port, path, origin=f"http://{address.hostname}:{address.port}", **more)
        self.serial, self.silent, self.hello = 0, False, None
        self.pictures = []

    def next(self):
        """(type, message): a picture is ("picture", (header, file))."""
        data = self.socket.receive()
        if data is None:
            raise Closed()
        if isinstance(data, str):
            message = json.loads(data)
            if message["type"] == "hello":
                self.hello = message
            return message["type"], message
        size = struct.unpack("<I", data[:4])[0]
        head, file = json.loads(data[4:4 + size]), data[4 + size:]
        if not self.silent:
            self.socket.send({"type": "ack", "number": head["frame"]})
        return "picture", (head, file)

    def wait(self, kind, condition=lambda message: True, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found, message = self.next()
            if found == "error" and kind != "error":
                raise RuntimeError(message["text"])
            if found == kind and condition(message):
                return message
        raise TimeoutError(kind)

    def look(self, **camera):
        """Sends a camera at rest."""
        self.serial += 1
        self.socket.send({"type": "camera", "serial": self.serial, "moving": False, **camera})

    def final(self, **camera):
        """(header, file) of the lossless picture of a camera."""
        self.look(**camera)
        return self.wait("picture", lambda picture: picture[0]["serial"] == self.serial and picture[0]["lossless"])

    def final_or_any(self, **camera):
        """A picture of full size; without loss only if the model does not change."""
        self.look(**camera)
        return self.wait("picture", lambda picture: picture[0]["serial"] == self.serial and picture[0]["width"] == camera["width"])

    def ask(self, kind, **message):
        self.socket.send({"type": kind, **message})
        return self.wait(kind)


def read_to_end(page):
    """Until the other side ends the connection."""
    try:
        while True:
            page.next()
    except (Closed, OSError):
        pass


def expect(name, condition, detail=""):
    print(("ok " if condition else "FAIL ") + name + (f": {detail}" if detail != "" and not condition else ""))
    if not condition:
        expect.failed += 1


expect.failed = 0


def pictures(url, folder):
    """Writes view.png (view 0), free.png and free.json (a free camera and its path file), samples.png."""
    page = Page(url)
    hello = page.wait("hello")
    view = hello["views"][0]
    sizes = {"width": view["width"], "height": view["height"]}
    expect("the_lens_is_described", view["lens"] == "OPENCV" and view["params"][:4] == view["intrinsics"] and len(view["params"]) == 8
           and any(view["params"][4:]), view)
    matrix = list(view["camera_to_world"])
    matrix[3] += 0.05 * hello["extent"]
    frame = {"camera_to_world": matrix, "fov": 61.7}
    path = {"camera_type": "perspective", "render_width": 97, "render_height": 61, "camera_path": [frame]}
    for name, camera in {"view": {**sizes, "view": 0}, "normal": {**sizes, "view": 0, "aov": "normal"}, "free": {"width": 97, "height": 61, **frame},
                         "samples": {**sizes, "view": 0, "samples": 4}}.items():
        with open(os.path.join(folder, name + ".png"), "wb") as file:
            file.write(page.final(**camera)[1])
    with open(os.path.join(folder, "free.json"), "w") as file:
        json.dump(path, file)
    page.final(**sizes, view=0)
    pixels = []
    for x, y in ((3, 5), (sizes["width"] // 2, sizes["height"] // 2), (sizes["width"] - 1, sizes["height"] - 1)):
        pixels.append({"probe": page.ask("probe", x=x, y=y), "ray": page.ask("ray", x=x, y=y)})
    with open(os.path.join(folder, "pixels.json"), "w") as file:
        json.dump({"pixels": pixels, "aovs": [row["name"] for row in hello["aovs"]]}, file)
    page.socket.close()


def crop(url):
    """Saves a crop; prints its path, and what `convert` needs for the same file."""
    page = Page(url)
    hello = page.wait("hello")
    low = [value - hello["extent"] / 2 for value in hello["target"]]
    high = [value + hello["extent"] / 2 for value in hello["target"]]
    crop = {"preview": "hide", "box": [*low, *high], "opacity": 0.125, "floaters": True}
    head = page.final(width=64, height=48, view=0, crop=crop)[0]
    saved = page.ask("crop")
    if head["removed"] != saved["removed"] or not saved["removed"] or not saved["kept"]:
        sys.exit(f"removed {head['removed']} in the picture, {saved['removed']} in the file, kept {saved['kept']}")
    # Nothing is saved instead of a crop that is refused, or that keeps nothing.
    for wrong, text in (({"opacity": 2}, "out of range"), ({"box": [1e9] * 6}, "keeps no primitive")):
        page.socket.send({"type": "crop", "crop": wrong})
        if text not in page.wait("error")["text"]:
            sys.exit(f"a crop of {wrong} is not refused")
    print(saved["path"], "--filter-box=" + ",".join(map(repr, crop["box"])), "--filter-opacity 0.125 --filter-floaters auto",
          hello["marks"])


def progressive(url):
    """Pictures grow at rest; movement replaces a picture; AOVs have ranges; slow pages get few pictures."""
    page = Page(url)
    matrix = page.wait("hello")["views"][0]["camera_to_world"]
    head = page.final(width=64, height=32, camera_to_world=matrix, fov=60, camera_type="equirectangular")[0]
    expect("a_panorama_is_drawn", head["width"] == 64, head)  # smaller ones fail: too few pixels for the lens
    head = page.final(width=64, height=48, view=0, crop={"preview": "hide", "box": [1e9, None, None, 2e9, None, None]})[0]
    expect("an_empty_crop_is_drawn", head["removed"] == head["gaussians"], head)
    head = page.final(width=64, height=48, view=0, aov="primitive", crop={"preview": "hide", "opacity": 0.5})[0]
    expect("an_aov_that_is_not_cropped_has_no_removed_primitives", "removed" not in head, head)
    page.final(width=64, height=48, view=0, crop={"preview": "hide", "box": [1e9, None, None, 2e9, None, None]})
    empty = page.ask("probe", x=30, y=20)
    expect("the_values_of_a_pixel_are_those_of_the_crop", empty["depth"] == 0 and empty["hits"] == 0 and empty["primitive"] is not None, empty)
    page.socket.close()
    page = Page(url)
    page.wait("hello")
    page.look(width=400, height=300, view=0)
    widths = []
    while True:
        head = page.wait("picture")[0]
        widths.append(head["width"])
        if head["lossless"]:
            break
    expect("pictures_grow_to_full_size", widths == sorted(widths) and widths[-1] == 400 and len(widths) >= 2, widths)
    low = page.final(width=64, height=48, view=0, aov="depth")[0]["range"]
    expect("an_aov_has_a_range", 0 < low[0] < low[1], low)
    fixed = page.final(width=64, height=48, view=0, aov="depth", range=[1, 2], log=True)[0]["range"]
    expect("a_given_range_is_used", fixed == [1, 2], fixed)
    page.silent = True
    for _ in range(50):
        page.serial += 1
        page.socket.send({"type": "camera", "serial": page.serial, "moving": True, "width": 64, "height": 48, "view": 0})
        time.sleep(0.01)
    page.socket.socket.settimeout(1.5)
    count = 0
    try:
        while True:
            count += page.next()[0] == "picture"
    except TimeoutError:
        pass
    expect("unacknowledged_pictures_are_few", 1 <= count <= 2, count)
    page.socket.close()


def hostile(url):
    """Malformed frames, texts and requests; afterwards the server still draws."""
    random.seed(1)
    address = urlparse(url)

    def connected():
        try:
            page = Page(url)
            page.wait("hello")
            return page
        except (Closed, OSError):
            return None

    texts = ["", "{", "[" * 60000, '{"a":"' + "]" * 3000 + '","b":' + "[" * 2000 + "]" * 2000 + "}", '{"type":"camera"}', "\x00", '{"type":"probe","x":1e308,"y":-1}', "x" * 70000,
             '{"type":"run","action":"stop"}', '{"type":"exr"}', '{"type":"ray","x":0,"y":0}', '{"type":"region","number":7}']
    for text in texts:
        page = connected()
        try:
            page.socket.send(text)
            page.socket.frame(9, b"ping")
        except OSError:
            pass
        page.socket.close()
    for opcode, payload, more in ((1, b"\xff\xfe", {}), (2, b"binary", {}), (3, b"x", {}), (1, b"{}", {"final": False}),
                                  (0, b"rest", {}), (8, b"", {}), (8, b"\x03", {}), (1, b"{}", {"masked": False}),
                                  (1, b"{}", {"reserved": 7}), (9, b"p" * 125, {}), (10, b"", {})):
        page = connected()
        try:
            page.socket.frame(opcode, payload, **more)
            page.socket.frame(1, b"{}")
        except OSError:
            pass
        page.socket.close()
    page = connected()
    page.socket.socket.sendall(bytes([0x81, 0xFF]) + struct.pack(">Q", 1 << 62) + b"mask")  # a frame of 4 EiB
    page.socket.close()
    for _ in range(60):
        page = connected()
        try:
            page.socket.socket.sendall(random.randbytes(random.randrange(1, 400)))
        except OSError:
            pass
        page.socket.close()
    requests = [b"GET", b"GET / HTTP/9.9\r\n\r\n", b"\r\n\r\n\r\n", b"GET /" + b"a" * 30000 + b" HTTP/1.1\r\n\r\n",
                b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999999\r\n\r\n",
                b"GET /photo/99999999999999999999 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
                b"GET /photo/-1 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
                b"GET http://evil.example/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
                b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n"]
    requests += [random.randbytes(random.randrange(1, 600)) for _ in range(60)]
    for request in requests:
        link = socket.create_connection((address.hostname, address.port), timeout=5)
        try:
            link.sendall(request)
            link.shutdown(socket.SHUT_WR)
            link.recv(1)
        except OSError:
            pass
        link.close()
    page = connected()
    expect("draws_after_hostile_input", page is not None and page.final(width=64, height=48, view=0)[1][:4] == b"\x89PNG")
    page.socket.close()


def storm(url, count):
    """`count` malformed frames and requests, four in five as messages of one connection after the other; then it draws."""
    random.seed(2)
    count, address = int(count), urlparse(url)
    good = ['{"type":"camera","serial":1,"moving":false,"width":64,"height":48,"view":0,"aov":"depth","range":[1,2],"samples":4,'
            '"crop":{"preview":"hide","box":[0,0,0,1,1,1],"opacity":0.5,"region":3}}',
            '{"type":"probe","x":3,"y":4}', '{"type":"ray","x":1,"y":1}', '{"type":"region","number":7}', '{"type":"history"}',
            '{"type":"ack","number":3}', '{"type":"camera","camera_to_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],"fov":50,"width":9,"height":9}']

    def mutated(text):
        data = bytearray(text.encode())
        for _ in range(random.randrange(1, 6)):
            at = random.randrange(len(data))
            kind = random.randrange(4)
            if kind == 0:
                data[at] = random.randrange(256)
            elif kind == 1:
                del data[at:at + random.randrange(1, 9)]
            elif kind == 2:
                data[at:at] = random.choice([b"1e999", b"-1", b"null", b"[", b"{", b'"', b"\\u0000", b"99999999999999999999", b"NaN"])
            else:
                data[at:] = b""
            if not data:
                break
        return bytes(data)

    sent = 0
    while sent < count:
        try:
            page = Page(url)
            for _ in range(min(80, count - sent)):
                page.socket.frame(random.choice((1, 1, 1, 1, 2)), mutated(random.choice(good)))
                sent += 1
            broken = random.choice(({"final": False}, {"masked": False}, {"reserved": random.randrange(1, 8)}, {}))
            page.socket.frame(random.randrange(16), random.randbytes(random.randrange(0, 300)), **broken)
            page.socket.close()
        except (Closed, OSError):
            pass
        for _ in range(min(20, count - sent)):
            sent += 1
            head = mutated(f"GET /{random.choice(('', 'photo/0', 'thumb/3', 'stream'))} HTTP/1.1\r\nHost: {address.netloc}\r\n"
                           "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
                           "Sec-WebSocket-Version: 13\r\n\r\n")
            try:
                link = socket.create_connection((address.hostname, address.port), timeout=5)
                link.sendall(head)
                if random.randrange(4):  # else half-open: closed without a word
                    link.shutdown(socket.SHUT_WR)
                    link.recv(1)
                link.close()
            except OSError:
                pass
    end = time.monotonic() + 60
    page = None
    while not page and time.monotonic() < end:
        try:
            page = Page(url)
            page.wait("hello")
        except (Closed, OSError, TimeoutError):
            page = None
    expect("draws_after_the_storm", page is not None and page.final(width=64, height=48, view=0)[1][:4] == b"\x89PNG")
    print(f"{sent} malformed frames and requests")


def many(url):
    """Eight pages are served, the ninth is told so; 200 connections come and go."""
    pages = [Page(url) for _ in range(8)]
    for page in pages:
        page.wait("hello")
    ninth = Page(url)
    expect("the_ninth_page_is_told_so", ninth.next()[0] == "full")
    try:
        expect("the_ninth_connection_is_closed", ninth.socket.receive() is None)
    except Closed:
        expect("the_ninth_connection_is_closed", True)
    threads = [threading.Thread(target=page.final, kwargs={"width": 64 + k, "height": 48, "view": 0}) for k, page in enumerate(pages)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    expect("eight_pages_are_drawn", not any(thread.is_alive() for thread in threads))
    for page in pages + [ninth]:
        page.socket.close()
    end = time.monotonic() + 30
    count = 0
    while count < 200 and time.monotonic() < end:
        try:
            page = Page(url)
            kind = page.next()[0]
            if kind == "hello":
                count += 1
                if count % 10 == 0:
                    page.look(width=64, height=48, view=0)
            page.socket.close()
        except (Closed, OSError):
            pass
    expect("200_connections_come_and_go", count == 200, count)


def small_socket(segment=None):
    """For socket.create_connection: little room for what is received; `segment`: the size of a TCP segment, as little for
    what is sent."""

    def connect(at, timeout=None):
        link = socket.socket()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        if segment:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, segment)
        link.settimeout(timeout)
        link.connect(at)
        return link

    return connect


def page_on(connect, url):
    """A page whose socket is made by `connect`."""
    plain = socket.create_connection
    socket.create_connection = connect
    try:
        return Page(url)
    finally:
        socket.create_connection = plain


def served_beside_a_deaf_page(url):
    """Pictures arrive at one page while the server waits for room to send one to another page: that one then still gets its
    picture whole. If the server had waited until its time limit, it would have dropped the page in the middle."""
    deaf = page_on(small_socket(536), url)
    deaf.look(width=960, height=540, view=0, aov="normal")  # a picture of about 500,000 bytes
    page = Page(url)
    page.wait("hello")
    for view in range(6):  # in turn with the two or three of the other page
        page.final(width=64, height=48, view=view)
    page.socket.close()
    try:
        deaf.wait("picture", lambda picture: picture[0]["lossless"])
    except (Closed, OSError):
        return False
    finally:
        deaf.socket.close()
    return True


def never_reads(url):
    """Pages that never read do not delay another one."""
    # On a loaded machine the pictures may take longer than the server's time limit.
    expect("a_deaf_page_delays_nobody", any(served_beside_a_deaf_page(url) for _ in range(5)))
    deaf = Page(url)
    for serial in range(300):
        try:
            deaf.socket.send({"type": "camera", "serial": serial, "moving": serial % 2 == 0, "width": 64, "height": 48, "view": 0})
            deaf.socket.send({"type": "history"})
            deaf.socket.send({"type": "ack", "number": serial})
        except OSError:
            break
    page = Page(url)
    page.wait("hello")
    page.final(width=64, height=48, view=0)
    page.socket.close()
    deaf.socket.close()


def frames(url):
    """What the server answers to frames: status of its close frame, pongs, messages in parts, and parts that do not end."""

    def answer(*sent, raw=b""):
        page = Page(url)
        page.wait("hello")
        try:
            for opcode, payload, more in sent:
                page.socket.frame(opcode, payload, **more)
            page.socket.socket.sendall(raw)
            opcode, size, _ = page.socket.head()
            payload = page.socket.take(size)
        except (Closed, OSError):
            opcode, payload = None, b""
        page.socket.close()
        return struct.unpack(">H", payload[:2])[0] if opcode == 8 and len(payload) >= 2 else (opcode, payload[:17])

    part, history = {"final": False}, b'{"type":"history"}'
    cases = {
        "close": (answer((8, b"\x03\xe8", {})), 1000),
        "ping": (answer((9, b"x" * 10, {})), (10, b"x" * 10)),
        "parts": (answer((1, history[:9], part), (9, b"", {}), (0, history[9:], {})), (10, b"")),
        "two_parts": (answer((1, history[:9], part), (0, history[9:], {})), (1, b'{"type":"history"')),
        "unmasked": (answer((1, history, {"masked": False})), 1002),
        "reserved_bits": (answer((1, history, {"reserved": 4})), 1002),
        "long_ping": (answer((9, b"x" * 126, {})), 1002),
        "continuation_of_nothing": (answer((0, b"{}", {})), 1002),
        "binary": (answer((2, b"{}", {})), 1003),
        "long": (answer((1, b"x" * 65537, {})), 1009),
        "long_in_parts": (answer((1, b"x" * 40000, part), (0, b"x" * 40000, {})), 1009),
        "announced_4_EiB": (answer(raw=bytes([0x81, 0xFF]) + struct.pack(">Q", 1 << 62)), 1009),
    }
    for name, (found, expected) in cases.items():
        expect("answer_to_" + name, found == expected, (found, expected))
    pages = [Page(url) for _ in range(8)]  # all slots
    for page in pages:
        page.wait("hello")
        page.socket.socket.sendall(bytes([0x81, 0xFE]) + struct.pack(">H", 100) + b"maskx")  # 1 of 100 bytes
    end, kind = time.monotonic() + 120, None
    while kind != "hello" and time.monotonic() < end:
        late = Page(url)
        kind = late.next()[0]
        late.socket.close()
        time.sleep(0.5)
    expect("frames_that_do_not_end_give_their_slots_back", kind == "hello", kind)
    for page in pages:
        page.socket.close()


def idle(url):
    """Connections without a request, which take threads of the server, do not delay a page."""
    address = urlparse(url)
    links = [socket.create_connection((address.hostname, address.port)) for _ in range(100)]
    with urlopen(url) as answer:
        expect("a_page_next_to_idle_connections", answer.status == 200)
    closed = 0
    for link in links:
        link.setblocking(False)
        try:
            closed += link.recv(1) == b""
        except BlockingIOError:
            pass
        link.close()
    expect("it_does_not_wait_for_their_end", closed == 0, closed)


def stalled(url, seconds):
    """A page that stops reading within a picture is dropped there: nothing follows a part of a message. Reads again after
    1 to 2 times the server's time limit, when a server that continues is sending the next message."""
    deaf = page_on(small_socket(), url)
    deaf.wait("hello")
    deaf.look(width=4000, height=4000, view=0)
    size = 0
    while size <= 4 << 20:  # up to a picture that is larger than the buffer of a socket (tcp_wmem)
        opcode, size, _ = deaf.socket.head()
        payload = deaf.socket.take(size) if size <= 4 << 20 else b""
        if opcode == 9:
            deaf.socket.frame(10, payload)
        elif payload:
            head = json.loads(payload[4:4 + struct.unpack("<I", payload[:4])[0]])
            deaf.socket.send({"type": "ack", "number": head["frame"]})
    deaf.socket.send({"type": "history"})
    time.sleep(float(seconds))
    data = deaf.socket.buffer
    try:
        while part := deaf.socket.socket.recv(1 << 20):
            data += part
    except OSError:
        pass
    expect("the_end_is_a_part_of_the_picture", len(data) < size, (len(data), size))
    expect("nothing_follows_the_part", b'{"type":"history"' not in data, data.find(b'{"type":"history"'))


def when_served(url, seconds=120):
    """The page of a server that may not have started."""
    end = time.monotonic() + seconds
    while True:
        try:
            return Page(url)
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
            time.sleep(0.01)


def move(url, early=""):
    """Moves until the connection ends; prints a line after the first picture, and at the end the iteration of the last one
    and the number of pictures. With `early`, waits for the server."""
    count, iteration = 0, 0
    try:
        page = when_served(url) if early else Page(url)
        matrix = list(page.wait("hello")["views"][0]["camera_to_world"])
        while True:
            page.serial += 1
            matrix[3] += 0.001
            page.socket.send({"type": "camera", "serial": page.serial, "moving": page.serial % 8 != 0, "width": 160,
                              "height": 90, "camera_to_world": matrix, "fov": 50})
            iteration = page.wait("picture")[0]["iteration"]
            count += 1
            if count == 1:
                print("first picture", flush=True)
    except (Closed, OSError):
        print(f"last iteration {iteration}\n{count}")


def control(url, folder):
    """Operates a training run from its page; stops it at the end."""
    page = Page(url)
    hello = page.wait("hello")
    expect("a_training_is_announced", hello["training"] and hello["progress"]["total"] == 100000)
    expect("the_extent_is_that_of_the_model", hello["extent"] != 1 and any(hello["target"]), hello["extent"])  # 1: of no primitive
    first = page.wait("progress", lambda message: message["iteration"] > 10)
    expect("progress_has_phases", first["phases"]["forward"] > 0 and first["rate"] > 0 and first["rss"] > 0, first)
    page.socket.send({"type": "run", "action": "pause"})
    paused = page.wait("progress", lambda message: message["paused"])
    time.sleep(0.5)
    head = page.final(width=120, height=66, view=0)[0]  # lossless: a paused model does not change
    page.socket.send({"type": "run", "action": "pause"})
    still = page.wait("progress")
    time.sleep(1)
    page.socket.send({"type": "run", "action": "pause"})
    later = page.wait("progress")
    expect("a_pause_shows_the_last_iteration", head["iteration"] == still["iteration"], (head, still))
    expect("a_pause_holds", still["iteration"] == later["iteration"] <= paused["iteration"] + 1, (paused, still, later))
    state = os.path.join(folder, "checkpoint", "state.bin")
    expect("no_checkpoint_yet", not os.path.exists(state))
    page.socket.send({"type": "run", "action": "checkpoint"})
    end = time.monotonic() + 20
    while not os.path.exists(state) and time.monotonic() < end:
        time.sleep(0.05)
    expect("a_checkpoint_is_saved_while_paused", os.path.exists(state))
    page.socket.send({"type": "run", "action": "continue"})
    page.wait("progress", lambda message: message["iteration"] > later["iteration"] + 100)
    rows = page.ask("history")["train"]
    expect("the_table_grows", rows["iteration"][:1] == [100] and len(rows["loss"]) == len(rows["iteration"]) > 0, rows)
    page.final_or_any(width=120, height=66, view=0)
    ray = page.ask("ray", x=60, y=33)
    expect("a_ray_is_explained_in_a_training", ray["count"] > 0 and len(ray["hits"]) == ray["count"])
    page.socket.send({"type": "run", "action": "stop"})
    read_to_end(page)


def limited(url):
    """Pictures and EXR files stay within the memory of a training with --max-memory, and the page is told. Stops the training."""
    page = Page(url)
    page.wait("hello")
    page.look(width=4096, height=4096, view=0, crop={"preview": "hide", "opacity": 0.5})
    sizes, head, text, end = [], {}, "", time.monotonic() + 120
    while not text and time.monotonic() < end:
        kind, message = page.next()
        if kind == "picture":
            head = message[0]
            sizes.append(head["width"] * head["height"])
        text = message["text"] if kind == "error" else ""
    expect("the_page_is_told", text == "frames are limited to 2083333 pixels by --max-memory", text)
    expect("pictures_fit_the_memory", sizes == sorted(sizes) and 2.0e6 < sizes[-1] <= 2083333, sizes)
    expect("the_largest_picture_is_the_last_and_lossless", head["lossless"] and head.get("limited") is True, head)
    expect("no_crop_takes_memory_for_another_model", "removed" not in head, head)
    page.socket.send({"type": "exr"})
    text = page.wait("error")["text"]
    expect("an_exr_file_is_refused", "an EXR file of more than 1000000 pixels exceeds" in text, text)
    before = page.wait("progress")["iteration"]
    page.wait("progress", lambda message: message["iteration"] > before)  # the memory was compared with the limit
    with urlopen(url + "photo/0") as answer:
        expect("a_small_photo_is_shown", answer.status == 200)
    run_action(url, "stop")


def paused(url):
    """A pause shows the iteration at which the training stands. Stops the training."""
    page = Page(url)
    page.wait("hello")
    for _ in range(3):
        page.wait("progress", lambda message: message["iteration"] > 5 and not message["paused"])
        page.socket.send({"type": "run", "action": "pause"})
        page.wait("progress", lambda message: message["paused"])
        time.sleep(1)
        head = page.final(width=120, height=66, view=0)[0]
        page.socket.send({"type": "run", "action": "pause"})
        still = page.wait("progress")
        expect("a_pause_shows_the_last_iteration", head["iteration"] == still["iteration"], (head, still))
        page.socket.send({"type": "run", "action": "continue"})
        page.wait("progress", lambda message: message["iteration"] > still["iteration"])
    run_action(url, "stop")


def run_action(url, action, leave=""):
    """Sends an action to a training run and stays until the connection ends, or with `leave` until it is announced."""
    page = Page(url)
    page.wait("hello")
    page.socket.send({"type": "run", "action": action})
    if leave:
        page.wait("progress", lambda message: message["paused"] == (action == "pause"))
        page.socket.close()
        return
    read_to_end(page)


def save_exr(url):
    """Requests an EXR file of two megapixels from a training run; prints a line once it is requested."""
    page = Page(url)
    page.wait("hello")
    page.wait("progress", lambda message: message["iteration"] > 5)
    page.look(width=1600, height=1200, view=0)
    page.socket.send({"type": "exr"})
    print("requested", flush=True)
    read_to_end(page)


def late(url):
    """Controls a training run after its last iteration."""
    page = Page(url)
    page.wait("hello")
    page.wait("progress", lambda message: message["finished"])
    for action in ("pause", "stop"):
        page.socket.send({"type": "run", "action": action})
    print("late", flush=True)
    read_to_end(page)


def status(url, *headers):
    """The HTTP status of a WebSocket handshake with these extra headers."""
    address = urlparse(url)
    path = "/stream" + ("?" + address.query if address.query else "")
    print(WebSocket(address.hostname, address.port, path, headers=headers).status)


def main():
    url, command = sys.argv[1:3]
    {"pictures": pictures, "crop": crop, "progressive": progressive, "hostile": hostile, "many": many, "storm": storm,
     "never_reads": never_reads, "stalled": stalled, "idle": idle, "frames": frames, "move": move,
     "control": control, "limited": limited, "paused": paused, "action": run_action, "exr": save_exr, "late": late,
     "status": status}[command](url, *sys.argv[3:])
    sys.exit(1 if expect.failed else 0)


if __name__ == "__main__":
    main()
