"""The page of a farm under test: its address, its token, and requests to it as a browser, a program or an
attacker would send them.

    page = Page(farm.start_coordinator())
    page.get("/healthz").status
    page.raw(b"GET / HTTP/1.1\\r\\n...")      # bytes in, bytes out
"""
import http.client
import json
import re
import socket
import ssl

from farm import BUILD, Failure, PATIENCE, Skip, answer_comes


def need_page():
    if "noweb" in BUILD:
        raise Skip("this build has no page (WEB=0)")


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def json(self):
        return json.loads(self.body)

    def __str__(self):
        return "%d %s %s" % (self.status, dict(self.headers), self.body[:500])


class Page:
    def __init__(self, coordinator):
        """Of a coordinator that has just been started; Skip where the build has none."""
        need_page()
        url = coordinator.wait_line("page: ")
        found = re.fullmatch(r"(https?)://(.*):(\d+)/#token=(\S+)", url)
        if not found:
            raise Failure("no address of a page: '%s'" % url)
        self.tls = found.group(1) == "https"
        self.name, self.port, self.token = found.group(2), int(found.group(3)), found.group(4)
        self.origin = "%s://%s:%d" % (found.group(1), self.name, self.port)
        self.host = "%s:%d" % (self.name, self.port)
        self.connect_to = "127.0.0.1"

    def connect(self, limit_s=20):
        peer = socket.create_connection((self.connect_to, self.port), timeout=limit_s * PATIENCE)
        if self.tls:
            context = ssl._create_unverified_context()  # pylint: disable=protected-access
            peer = context.wrap_socket(peer, server_hostname=self.name)
        return peer

    def request(self, method, path, body=None, headers=None, token=None, limit_s=20):
        """token: None: the coordinator's own; "": none."""
        link = http.client.HTTPConnection(self.name, self.port, timeout=limit_s * PATIENCE)
        link.sock = self.connect(limit_s)
        sent = {"Host": self.host}
        if token != "":
            sent["Authorization"] = "Bearer " + (token or self.token)
        if isinstance(body, (dict, list)):
            body = json.dumps(body)
        sent.update(headers or {})
        try:
            link.request(method, path, body=body, headers=sent)
            answer = link.getresponse()
            body = answer.read()
            answer_comes()
            return Answer(answer.status, answer.headers, body)
        finally:
            link.close()

    def get(self, path, **how):
        return self.request("GET", path, **how)

    def post(self, path, body=None, **how):
        return self.request("POST", path, body=body if body is not None else {}, **how)

    def raw(self, data, limit_s=20, until=None):
        """Send the bytes and return what comes until the end of the connection, or until `until(bytes)`."""
        got = b""
        with self.connect(limit_s) as peer:
            try:
                peer.sendall(data)
                while not (until and until(got)):
                    piece = peer.recv(65536)
                    if not piece:
                        break
                    got += piece
            except (ConnectionResetError, BrokenPipeError):
                pass
        return got
