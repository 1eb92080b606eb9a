#!/usr/bin/env python3
"""Tokens of the page and its API: made, used, limited by role, revoked, expired; signing in; wrong ones."""
import getpass
import json
import os
import re
import socket
import stat
import time

from farm import Failure, Farm, Tests, wait_for
from jobs import expect
from page import Page, need_page
from websocket import Closed, Refused, WebSocket

tests = Tests()
ME = "%s@%s" % (getpass.getuser(), socket.gethostname())


def started(farm, *options, **how):
    return Page(farm.start_coordinator(*options, **how))


def create(farm, role, *options):
    """A new token: its description with its secret."""
    made = farm.cli("token", "create", "--role", role, "--json", *options, expect=0).json()
    return dict(made["info"], secret=made["secret"])


def listed(farm):
    return farm.cli("token", "list", "--json", expect=0).json()["tokens"]


def audit(farm):
    with open(farm.path("store", "audit.log"), encoding="utf-8") as log:
        return [json.loads(line) for line in log]


def role_of(page, secret):
    """The role that the API sees; None: none."""
    answer = page.get("/api/v1/session", token=secret)
    expect(answer.status in (200, 401), answer)
    return answer.json()["role"] if answer.status == 200 else None


def sign_in(page, secret):
    """The answer, and the cookie as a header."""
    answer = page.post("/api/v1/session", {"token": secret}, token="", headers={"Origin": page.origin})
    line = answer.headers.get("set-cookie", "")
    return answer, line.split(";")[0]


@tests.add
def life():
    """created with a role, listed, found, renewed and revoked, by number and by name, over kill -9"""
    with Farm() as farm:
        page = started(farm)
        own = listed(farm)
        expect([(t["token"], t["role"], t["owner"]) for t in own] == [(1, "admin", ME)], own)
        expect("this coordinator's" in farm.cli("token", expect=0).out, "it is named in the list")
        made = {role: create(farm, role, "--name", "for " + role, "--owner", "ana@ws3")
                for role in ("view", "submit", "operate", "admin")}
        plain = farm.cli("token", "create", "--role", "view", expect=0)
        expect(re.fullmatch(r"azt_[0-9a-f]{64}\n", plain.out) and "shown only now" in plain.err, plain)
        for again in (False, True):
            if again:
                farm.coordinator.kill()
                page = Page(farm.restart_coordinator())
            for role, token in made.items():
                who = page.get("/api/v1/session", token=token["secret"]).json()
                expect((who["role"], who["who"], who["token"], who["token_name"]) ==
                       (role, "ana@ws3", token["token"], "for " + role), who)
            rows = {t["token"]: t for t in listed(farm)}
            expect(len(rows) == 6 and rows[made["view"]["token"]]["made_by"] == ME, rows)
            expect(all(row["used_at"] > 0 for row in list(rows.values())[1:5]), rows)
        text = "".join(open(farm.path("store", name), "rb").read().decode("latin-1") for name in
                       ("queue.sqlite", "queue.sqlite-wal", "audit.log"))
        for token in made.values():
            expect(token["secret"] not in text and token["secret"][4:] not in text, "a token is in the store")
        renewed = farm.cli("token", "renew", "for view", "--json", expect=0).json()
        expect(renewed["info"]["token"] == made["view"]["token"] and renewed["secret"] != made["view"]["secret"], renewed)
        expect(role_of(page, made["view"]["secret"]) is None and role_of(page, renewed["secret"]) == "view", "renewed")
        farm.cli("token", "revoke", "for submit", expect=0)
        farm.cli("token", "revoke", made["operate"]["token"], expect=0)
        expect(role_of(page, made["submit"]["secret"]) is None, "revoked")
        expect(role_of(page, made["operate"]["secret"]) is None, "revoked")
        expect(role_of(page, made["admin"]["secret"]) == "admin", "the others stay")
        last = create(farm, "view")
        expect(last["token"] > 6, "numbers are not used again")
        for wrong, code, word in ((("create",), 2, "--role"), (("create", "--role", "all"), 2, "--role"),
                                  (("revoke",), 2, "which token"), (("revoke", "1"), 5, "token renew"),
                                  (("revoke", "99"), 5, "no token 99"), (("revoke", "nobody"), 5, "nobody"),
                                  (("renew", "99"), 5, "no token 99"), (("burn",), 2, "burn"),
                                  (("list", "--role", "view"), 2, "token create"),
                                  (("create", "--role", "view", "--expires", "0"), 2, "--expires"),
                                  (("create", "--role", "view", "--name", "x" * 64), 3, "63 bytes")):
            result = farm.cli("token", *wrong)
            expect(result.code == code and word in result.err, result)


@tests.add
def own():
    """the coordinator's own: in a file that only its owner reads, kept, renewed, and made again where it is damaged"""
    with Farm() as farm:
        page = started(farm)
        path = farm.path("store", "web.token")
        expect(stat.S_IMODE(os.stat(path).st_mode) == 0o600, "0600")
        expect(open(path, encoding="utf-8").read().strip() == page.token, "it is in the printed address")
        expect(stat.S_IMODE(os.stat(farm.path("store", "page.url")).st_mode) == 0o600, "0600")
        old = page.token
        farm.coordinator.kill()
        page = Page(farm.restart_coordinator())
        expect(page.token == old, "a restart keeps it")
        new = farm.cli("token", "renew", expect=0).out.strip()
        expect(new != old and role_of(page, old) is None and role_of(page, new) == "admin", "renewed")
        expect(open(farm.path("store", "page.url"), encoding="utf-8").read().strip().endswith("#token=" + new),
               "the address has the new one")
        for damaged in ("a word\n", "", new[:-1], new[:-1] + "x"):
            expect(farm.coordinator.stop() == 0, "it ends")
            with open(path, "w", encoding="utf-8") as out:
                out.write(damaged)
            page = Page(farm.start_coordinator())
            expect(page.token not in (old, new) and role_of(page, page.token) == "admin", "a new one")
            expect(role_of(page, new) is None, "the old one")
            expect("web.token: does not hold the page's token: a new one is made" in farm.coordinator.log_text(), damaged)


@tests.add
def roles():
    """each role may do what those before it may, and no more; nobody without a token"""
    with Farm() as farm:
        page = started(farm)
        secrets = {role: create(farm, role)["secret"] for role in ("view", "submit", "operate", "admin")}
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000")
        asks = [("GET", "/api/v1/jobs", None, "view"), ("GET", "/metrics", None, "view"),
                ("GET", "/api/v1/workers", None, "view"),
                ("POST", "/api/v1/blobs/missing", {"digest": ["00" * 32]}, "submit"),
                ("POST", "/api/v1/jobs/%d/pause" % job, {}, "operate"),
                ("POST", "/api/v1/jobs/%d/resume" % job, {}, "operate"),
                ("GET", "/api/v1/tokens", None, "admin"),
                ("POST", "/api/v1/store/collect", {}, "admin")]
        order = ("", "view", "submit", "operate", "admin")
        for method, path, body, least in asks:
            for role in order:
                answer = page.request(method, path, body=body, token=secrets.get(role, ""))
                allowed = order.index(role) >= order.index(least)
                own = role == "submit" and "/jobs/%d/" % job in path  # its owner is who made the token
                expect(answer.status == (401 if not role else 200 if allowed or own else 403), (method, path, role, answer))
                if own and path.endswith("pause"):
                    farm.cli("resume", job, expect=0)
                if allowed and path.endswith("pause") and role != "admin":
                    farm.cli("resume", job, expect=0)
                if (allowed or own) and path.endswith("resume"):
                    farm.cli("pause", job, expect=0)
                if answer.status >= 400:
                    expect(answer.headers["content-type"] == "application/problem+json", answer)


@tests.add
def owners():
    """a token for submitting steers its own jobs only"""
    with Farm() as farm:
        page = started(farm)
        mine = create(farm, "submit")["secret"]
        other = create(farm, "submit", "--owner", "eva@ws9")["secret"]
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000")
        refused = page.post("/api/v1/jobs/%d/pause" % job, token=other)
        expect(refused.status == 403, refused)
        expect(farm.job(job)["state"] == "queued", "nothing happened")
        expect(page.post("/api/v1/jobs/%d/pause" % job, token=mine).status == 200, "its own")
        expect(farm.job(job)["state"] == "paused", "paused")


class Listening:
    """A stream of events and a WebSocket that are open with a token."""

    def __init__(self, page, secret):
        self.stream = page.connect()
        self.stream.sendall(("GET /api/v1/events HTTP/1.1\r\nhost: %s\r\nauthorization: Bearer %s\r\n\r\n" % (
            page.host, secret)).encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += self.stream.recv(4096)
        expect(head.startswith(b"HTTP/1.1 200"), head)
        self.socket = WebSocket(page.host, "/api/v1/live", secret)
        self.socket.send({"resume": None})

    def stream_ended(self, limit_s):
        end = time.monotonic() + limit_s
        try:
            while time.monotonic() < end:
                self.stream.settimeout(max(0.01, end - time.monotonic()))
                if not self.stream.recv(65536):
                    return True
        except TimeoutError:
            return False
        except OSError:
            return True
        return False

    def socket_ended(self, limit_s):
        end = time.monotonic() + limit_s
        try:
            while time.monotonic() < end:
                self.socket.receive(max(0.01, end - time.monotonic()))
        except (Closed, OSError):
            return True
        return False

    def close(self):
        self.stream.close()
        self.socket.drop()


@tests.add
def ends_at_once():
    """revoked, renewed or expired: streams and WebSockets that are open with it end, others stay"""
    with Farm() as farm:
        page = started(farm)
        stays = Listening(page, create(farm, "view", "--name", "stays")["secret"])
        for how in ("revoke", "renew", "expire"):
            life = ("--expires", "3s") if how == "expire" else ()
            token = create(farm, "view", "--name", how, *life)
            open_with_it = Listening(page, token["secret"])
            expect(not open_with_it.stream_ended(0.3) and not open_with_it.socket_ended(0.3), "open")
            if how != "expire":
                farm.cli("token", how, how, expect=0)
                expect(role_of(page, token["secret"]) is None, "no new request")
            expect(open_with_it.stream_ended(8) and open_with_it.socket_ended(8), how)
            expect(role_of(page, token["secret"]) is None, how)
            expect(page.get("/api/v1/events", token=token["secret"]).status == 401, "no new stream")
            try:
                WebSocket(page.host, "/api/v1/live", token["secret"]).drop()
                expect(False, "a WebSocket was opened with a token that ended")
            except Refused as refused:
                expect(refused.status == 401, refused)
            open_with_it.close()
        expect(not stays.stream_ended(0.5) and not stays.socket_ended(0.5), "another token's stay")
        stays.close()


@tests.add
def a_renewed_one_holds():
    """what is begun with a renewed token stays, while that of the old one ends; no request with the new one is refused"""
    with Farm() as farm:
        page = started(farm)
        made = create(farm, "view", "--name", "desk")
        for _ in range(3):
            old = Listening(page, made["secret"])
            made = farm.cli("token", "renew", "desk", "--json", expect=0).json()
            new = Listening(page, made["secret"])
            until = time.monotonic() + 0.6  # longer than what was begun with the old one may stay
            while time.monotonic() < until:
                expect(role_of(page, made["secret"]) == "view", "the new token is refused")
            expect(old.stream_ended(8) and old.socket_ended(8), "what was begun with the old one")
            expect(not new.stream_ended(0.5) and not new.socket_ended(0.5), "what was begun with the new one")
            new.close()
            old.close()


@tests.add
def itself():
    """an admin's token that revokes itself over the API still gets its answer"""
    with Farm() as farm:
        page = started(farm)
        token = create(farm, "admin")
        answer = page.request("DELETE", "/api/v1/tokens/%d" % token["token"], token=token["secret"])
        expect(answer.status == 200 and [t["token"] for t in answer.json()["tokens"]] == [1], answer)
        expect(role_of(page, token["secret"]) is None, "it has ended")
        made = page.post("/api/v1/tokens", {"role": "view", "name": "api"})
        expect(made.status == 200 and role_of(page, made.json()["secret"]) == "view", made)
        renewed = page.post("/api/v1/tokens/%d/renew" % made.json()["info"]["token"], {})
        expect(renewed.status == 200 and role_of(page, renewed.json()["secret"]) == "view", renewed)
        expect(role_of(page, made.json()["secret"]) is None, "renewed")


@tests.add
def cookies():
    """signing in gives a cookie for its port, which survives a restart, is no token, and ends with the token"""
    with Farm() as farm:
        page = started(farm)
        token = create(farm, "operate", "--name", "desk")
        answer, cookie = sign_in(page, token["secret"])
        expect(answer.status == 200 and answer.json()["role"] == "operate", answer)
        line = answer.headers["set-cookie"]
        expect(cookie.startswith("azulejo_session_%d=" % page.port), line)
        for part in ("HttpOnly", "SameSite=Strict", "Path=/", "Max-Age=1209600"):
            expect(part in line, line)
        expect("Secure" not in line and token["secret"][4:] not in line, line)

        def with_cookie(text=None):
            return page.get("/api/v1/session", token="", headers={"Cookie": text or cookie}).status
        expect(with_cookie() == 200, "signed in")
        expect(with_cookie("other=1; %s; more=2" % cookie) == 200, "among others")
        expect(page.get("/api/v1/session", token=cookie.split("=", 1)[1]).status == 401, "it is no token")
        expect(with_cookie(cookie.replace("azulejo_session_%d" % page.port, "azulejo_session_1")) == 401, "another port's")
        expect(with_cookie(cookie[:-1] + ("0" if cookie[-1] != "0" else "1")) == 401, "forged")
        farm.coordinator.kill()
        page2 = Page(farm.restart_coordinator("--web", page.host))
        expect(page2.port == page.port and with_cookie() == 200, "it survives a restart")
        answer = page.request("DELETE", "/api/v1/session", token="", headers={"Cookie": cookie, "Origin": page.origin})
        expect(answer.status == 204 and "Max-Age=0" in answer.headers["set-cookie"], answer)
        answer = page.request("DELETE", "/api/v1/session", token="",
                              headers={"Cookie": cookie, "Origin": "http://evil.example"})
        expect(answer.status == 403, answer)
        expect(page.post("/api/v1/session", {"token": token["secret"]}, token="",
                         headers={"Origin": "http://evil.example"}).status == 403, "another page may not sign in")
        farm.cli("token", "renew", expect=0)
        expect(with_cookie() == 401, "the renewal of the coordinator's own signs everybody out")
        cookie = sign_in(page, token["secret"])[1]
        expect(with_cookie() == 200, "signed in again")
        farm.cli("token", "revoke", "desk", expect=0)
        expect(with_cookie() == 401, "it ends with its token")
        for body in ("", "{", "[]", "{}", '{"token": 1}', '{"token": "x", "more": 1}', '{"token": "%s"}' % ("x" * 5000)):
            answer = page.request("POST", "/api/v1/session", body=body, token="")
            expect(answer.status in (400, 401) and "set-cookie" not in answer.headers, (body, answer))


@tests.add
def guesses():
    """wrong tokens are refused, noted, and above 20 a minute answered 429; a right one is never locked out"""
    with Farm() as farm:
        page = started(farm)
        wrong = "azt_" + "0" * 64
        statuses = [page.get("/api/v1/jobs", token=wrong).status for _ in range(15)]
        statuses += [page.post("/api/v1/session", {"token": wrong}, token="").status for _ in range(15)]
        expect(statuses == 20 * [401] + 10 * [429], statuses)
        expect(page.get("/api/v1/jobs").status == 200, "a right one")
        expect(sign_in(page, page.token)[0].status == 200, "a right one")
        noted = lambda: [l for l in audit(farm) if l["verb"] == "sign in"]
        wait_for(lambda: len(noted()) >= 21, "the page's program to tell of them")
        lines = noted()
        expect([l["outcome"] for l in lines] == 20 * ["refused"] + ["done"], lines)
        expect(all(l["address"].startswith("127.0.0.1:") and l["key"] == "token" for l in lines), lines)
        expect(lines[-1]["details"] == {"token": 1, "name": "this coordinator's"} and lines[-1]["who"] == ME, lines[-1])
        text = open(farm.path("store", "audit.log"), encoding="utf-8").read() + farm.coordinator.log_text()
        expect(page.token not in text and "0" * 64 not in text, "no token is written down")
        metrics = page.get("/metrics").body.decode()
        expect("azulejo_web_wrong_tokens_total 30\n" in metrics, "they are counted")


@tests.add
def noted():
    """the audit log says with which token something was done"""
    with Farm() as farm:
        page = started(farm)
        token = create(farm, "operate", "--name", "night shift", "--owner", "eva@ws9")
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000")
        expect(page.post("/api/v1/jobs/%d/pause" % job, token=token["secret"]).status == 200, "paused")
        line = [l for l in audit(farm) if l["verb"] == "pause"][0]
        expect(line["who"] == "eva@ws9" and line["address"] == "API, token %d: night shift" % token["token"], line)
        farm.cli("token", "revoke", "night shift", expect=0)
        lines = [(l["verb"], l["outcome"], l["details"]) for l in audit(farm) if l["verb"].startswith("token")]
        expect(lines == [("token create", "done", {"name": "night shift", "role": "operate", "owner": "eva@ws9"}),
                         ("token revoke", "done", {"token": token["token"]})], lines)


@tests.add
def without_page():
    """a coordinator without its page says so"""
    with Farm() as farm:
        need_page()
        farm.start_coordinator("--no-web")
        result = farm.cli("token")
        expect(result.code == 3 and "--no-web" in result.err, result)


tests.run()
