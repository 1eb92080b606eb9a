"""A web server that events are posted to."""
import http.server
import json
import threading


class Receiver:
    """A server that keeps what it gets. answer(number, body) -> a status, or a status and headers; it may hang."""

    def __init__(self, answer=lambda number, body: 204, port=0, tls=None):
        outer = self
        self.got, self.answer, self.lock = [], answer, threading.Lock()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers.get("content-length", 0)))
                with outer.lock:
                    outer.got.append((self.path, dict(self.headers.items()), body))
                    number = len(outer.got)
                status = outer.answer(number, body)
                status, headers = status if isinstance(status, tuple) else (status, {})
                try:
                    self.send_response(status)
                    for name, value in headers.items():
                        self.send_header(name, value)
                    self.send_header("content-length", "0")
                    self.end_headers()
                except OSError:
                    pass

            do_GET = do_POST

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        if tls:
            self.server.socket = tls.wrap_socket(self.server.socket, server_side=True)
        self.port = self.server.server_address[1]
        self.url = "http%s://127.0.0.1:%d/hook" % ("s" if tls else "", self.port)
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def events(self):
        with self.lock:
            return [json.loads(body) for _, _, body in self.got]

    def stop(self):
        self.server.shutdown()
        self.server.server_close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()
