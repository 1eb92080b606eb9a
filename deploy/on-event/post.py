#!/usr/bin/python3
"""A program for azulejo-coordinator --on-event: posts the event to a web server, signed.

Copy it, name the file below, and make the copy executable. The file holds the address and the secret, a line each, and
only its owner may read it (chmod 600): neither is in an argument or in the environment. docs/OPERATIONS.md says how a
receiver checks the signature, and how systemd gives the coordinator the file.

Redirects are not followed, no proxy is used, certificates are checked, and of the answer only the status is read. Without
a 2xx it ends with status 75, and the coordinator runs it again.
"""
FILE = "/etc/azulejo/on-event"

import base64
import hashlib
import hmac
import http.client
import os
import sys
import time
import urllib.parse

TIMEOUT_S = 10                   # of each wait for the network
AGAIN = 75                       # EX_TEMPFAIL: the coordinator tries again


def read_file(path):
    """The address and the secret."""
    with open(path, encoding="utf-8") as source:
        if os.fstat(source.fileno()).st_mode & 0o037:  # systemd's credentials have the bit by which a group reads
            raise ValueError("%s: others can read it ('chmod 600 %s' prevents that)" % (path, path))
        lines = source.read().split()
    if len(lines) != 2:
        raise ValueError("%s: it has not two lines, an address and a secret" % path)
    url = urllib.parse.urlsplit(lines[0])
    if url.scheme not in ("http", "https") or not url.hostname or not all("!" <= c <= "~" for c in lines[0]):
        raise ValueError("%s: its first line is no address http://HOST/PATH or https://HOST/PATH" % path)
    return url, lines[1]


def post(url, secret, body):
    """The answer's status."""
    stamp = str(int(time.time()))
    mac = hmac.new(secret.encode(), stamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    headers = {"Content-Type": "application/json", "User-Agent": "azulejo-on-event",
               "X-Azulejo-Timestamp": stamp, "X-Azulejo-Signature": "sha256=" + mac}
    if url.username is not None:
        words = "%s:%s" % (urllib.parse.unquote(url.username), urllib.parse.unquote(url.password or ""))
        headers["Authorization"] = "Basic " + base64.b64encode(words.encode()).decode()
    kind = http.client.HTTPSConnection if url.scheme == "https" else http.client.HTTPConnection
    connection = kind(url.hostname, url.port, timeout=TIMEOUT_S)
    try:
        connection.request("POST", (url.path or "/") + ("?" + url.query if url.query else ""), body, headers)
        return connection.getresponse().status
    finally:
        connection.close()


def main():
    try:
        url, secret = read_file(FILE)
        status = post(url, secret, sys.stdin.buffer.read().strip())
    except (OSError, ValueError, http.client.HTTPException) as error:
        print(error or type(error).__name__, file=sys.stderr)  # none of them has the address or the secret
        return AGAIN
    if 200 <= status < 300:
        return 0
    print("the receiver answered %d" % status, file=sys.stderr)
    return AGAIN


sys.exit(main())
