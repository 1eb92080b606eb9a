"""A small WebSocket client (RFC 6455), for tests: it can read slowly, not at all, and vanish.

    with WebSocket("127.0.0.1:7421", "/api/v1/live", token) as ws:
        ws.send({"resume": None})
        kind, data = ws.receive(limit_s=5)      # "text": str, "binary": bytes; None when the limit has passed
"""
import base64
import hashlib
import json
import os
import socket
import struct
import time

MAGIC = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


class Refused(Exception):
    """The server answered the handshake with something else."""

    def __init__(self, status, head):
        super().__init__(head.split("\r\n")[0])
        self.status = status


class Closed(Exception):
    """The server ended the connection; `code` is None without a closing frame."""

    def __init__(self, code, reason=""):
        super().__init__(f"closed: {code} {reason}")
        self.code, self.reason = code, reason


class WebSocket:
    def __init__(self, address, path, token=None, origin=None, headers=(), receive_buffer=None, tls=None):
        host, port = address.rsplit(":", 1)
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(20)
        self.socket.connect((host.strip("[]"), int(port)))
        if tls:
            self.socket = tls.wrap_socket(self.socket, server_hostname=host)
        self.kept = b""
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {address}", "Upgrade: websocket", "Connection: Upgrade",
                 f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", f"Origin: {origin or 'http://' + address}"]
        if token:
            lines.append(f"Authorization: Bearer {token}")
        self.socket.sendall(("\r\n".join([*lines, *headers]) + "\r\n\r\n").encode())
        head = self._until(b"\r\n\r\n").decode()
        status = int(head.split(" ")[1])
        if status != 101:
            self.drop()
            raise Refused(status, head)
        accept = base64.b64encode(hashlib.sha1((key + MAGIC).encode()).digest()).decode()
        if accept.lower() not in head.lower():
            raise Refused(status, "the server's key is wrong")

    def __enter__(self):
        return self

    def __exit__(self, kind, value, trace):
        self.drop()

    def _more(self):
        data = self.socket.recv(1 << 16)
        if not data:
            raise Closed(None)
        self.kept += data

    def _until(self, mark):
        while mark not in self.kept:
            self._more()
        head, self.kept = self.kept.split(mark, 1)
        return head

    def _take(self, size):
        parts, have = [self.kept], len(self.kept)
        while have < size:
            data = self.socket.recv(1 << 18)
            if not data:
                raise Closed(None)
            parts.append(data)
            have += len(data)
        data = b"".join(parts)
        self.kept = data[size:]
        return data[:size]

    def _frame(self, kind, data):
        size = len(data)
        head = bytes([0x80 | kind])
        if size < 126:
            head += bytes([0x80 | size])
        elif size < 1 << 16:
            head += bytes([0x80 | 126]) + struct.pack(">H", size)
        else:
            head += bytes([0x80 | 127]) + struct.pack(">Q", size)
        mask = os.urandom(4)
        self.socket.sendall(head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def send(self, message):
        """Text as it is; anything else as JSON."""
        text = message if isinstance(message, str) else json.dumps(message)
        self._frame(TEXT, text.encode())

    def receive(self, limit_s=10.0):
        """The next message: ("text", str) or ("binary", bytes). None: there was none for so long."""
        parts, message = [], None
        end = time.monotonic() + limit_s
        while True:
            if not parts and not self.kept:
                self.socket.settimeout(max(end - time.monotonic(), 0.001))
                try:
                    self._more()
                except TimeoutError:
                    return None
            self.socket.settimeout(20)
            first, second = self._take(2)
            size = second & 127
            if size == 126:
                size = struct.unpack(">H", self._take(2))[0]
            elif size == 127:
                size = struct.unpack(">Q", self._take(8))[0]
            assert not second & 128, "a server's frame is not masked"
            data = self._take(size)
            kind = first & 15
            if kind == CLOSE:
                raise Closed(struct.unpack(">H", data[:2])[0] if len(data) >= 2 else None, data[2:].decode())
            if kind == PING:
                self._frame(PONG, data)
                continue
            if kind == PONG:
                continue
            message = kind or message
            parts.append(data)
            if first & 128:
                whole = b"".join(parts)
                return ("text", whole.decode()) if message == TEXT else ("binary", whole)

    def ping(self):
        self._frame(PING, b"")

    def close(self):
        self._frame(CLOSE, struct.pack(">H", 1000))

    def drop(self):
        """As if the machine vanished, but for the TCP connection's end."""
        try:
            self.socket.close()
        except OSError:
            pass
