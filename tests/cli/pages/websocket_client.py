# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""A WebSocket client (RFC 6455) with the standard library only, for the tests of the viewer and for Chromium's
DevTools protocol. Can send malformed frames."""

import base64
import json
import os
import socket
import struct


class Closed(Exception):
    """The other side ended the connection."""


class WebSocket:
    def __init__(self, host, port, path="/", origin=None, headers=(), timeout=30):
        self.socket = socket.create_connection((host, port), timeout=timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.buffer = b""
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}:{port}", "Upgrade: websocket", "Connection: Upgrade",
                 "Sec-WebSocket-Key: " + base64.b64encode(os.urandom(16)).decode(), "Sec-WebSocket-Version: 13"]
        if any(line.lower().startswith("host:") for line in headers):
            del lines[1]
        if origin:
            lines.append("Origin: " + origin)
        lines += headers
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        while b"\r\n\r\n" not in self.buffer:
            self._fill()
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        self.status = int(head.split()[1])
        if self.status != 101:
            self.socket.close()

    def _fill(self):
        data = self.socket.recv(1 << 16)
        if not data:
            raise Closed()
        self.buffer += data

    def take(self, count):
        while len(self.buffer) < count:
            self._fill()
        data, self.buffer = self.buffer[:count], self.buffer[count:]
        return data

    def frame(self, opcode, payload, final=True, masked=True, reserved=0):
        """Sends one frame, also one that the protocol forbids."""
        head = bytes([(128 if final else 0) | reserved << 4 | opcode])
        size, mask = len(payload), 128 if masked else 0
        if size < 126:
            head += bytes([mask | size])
        elif size < 65536:
            head += bytes([mask | 126]) + struct.pack(">H", size)
        else:
            head += bytes([mask | 127]) + struct.pack(">Q", size)
        key = os.urandom(4)
        if masked:
            padded = (key * (size // 4 + 1))[:size]
            payload = (int.from_bytes(payload, "big") ^ int.from_bytes(padded, "big")).to_bytes(size, "big") if size else b""
            head += key
        self.socket.sendall(head + payload)

    def send(self, message):
        self.frame(1, (message if isinstance(message, str) else json.dumps(message)).encode())

    def head(self):
        """Reads the head of a frame: opcode, size of the payload that follows, whether it is the last of its message."""
        first, second = self.take(2)
        size = second & 127
        if size == 126:
            size = struct.unpack(">H", self.take(2))[0]
        elif size == 127:
            size = struct.unpack(">Q", self.take(8))[0]
        return first & 15, size, bool(first & 128)

    def receive(self):
        """The next message: str, bytes, or None after a close frame."""
        parts = []
        while True:
            opcode, size, final = self.head()
            payload = self.take(size)
            if opcode == 8:
                return None
            if opcode == 9:
                self.frame(10, payload)
                continue
            if opcode == 10:
                continue
            parts.append(payload)
            text = opcode == 1 if opcode else text
            if final:
                data = b"".join(parts)
                return data.decode() if text else data

    def close(self):
        self.socket.close()
