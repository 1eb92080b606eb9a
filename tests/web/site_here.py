"""A small web server of the test's own, on another port: another origin."""
import http.server
import threading


class Site(http.server.ThreadingHTTPServer):
    """A few fixed answers: path -> (type, text)."""

    daemon_threads = True

    def __init__(self, answers):
        self.answers = answers
        super().__init__(("127.0.0.1", 0), Answering)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def url(self, path="/"):
        return "http://127.0.0.1:%d%s" % (self.server_port, path)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.shutdown()
        self.server_close()


class Answering(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        found = self.server.answers.get(self.path.split("?")[0])
        self.send_response(200 if found else 404)
        self.send_header("Content-Type", found[0] if found else "text/plain")
        self.end_headers()
        self.wfile.write((found[1] if found else "no such page").encode())

    def log_message(self, *_):
        pass
