#include "web/http/guard.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

enum { LOOPBACK_NAMES = 3 }; /* "localhost" and two addresses; a machine's own name follows them */

const struct guard_line guard_lines[GUARD_LINES] = {
    {"content-security-policy:",
     "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
     "frame-ancestors 'none'"},
    {"x-content-type-options:", "nosniff"},
    {"x-frame-options:", "DENY"},
    {"referrer-policy:", "no-referrer"},
    {"cross-origin-opener-policy:", "same-origin"},
    {"cross-origin-resource-policy:", "same-origin"},
};

/* ---- names ----------------------------------------------------------------------------------- */

static int is_address(const char *text, int family)
{
    unsigned char bytes[16];

    return inet_pton(family, text, bytes) == 1;
}

/* An IPv6 address in brackets. */
static int is_bracketed(const char *text)
{
    char inner[GUARD_NAME_MAX + 1];
    size_t size = strlen(text);

    if (size < 4 || size > GUARD_NAME_MAX || text[0] != '[' || text[size - 1] != ']')
        return 0;
    memcpy(inner, text + 1, size - 2);
    inner[size - 2] = 0;
    return is_address(inner, AF_INET6);
}

static int is_name(const char *text)
{
    size_t size = strlen(text);

    if (size == 0 || size > GUARD_NAME_MAX)
        return 0;
    for (const char *c = text; *c; c++)
        if (!isalnum((unsigned char)*c) && *c != '-' && *c != '.' && *c != '_')
            return 0;
    return 1;
}

static void add_name(struct guard *guard, const char *name)
{
    char *out = guard->names[guard->name_count];

    if (guard->name_count == GUARD_NAMES_MAX || strlen(name) > GUARD_NAME_MAX - 2)
        return;
    snprintf(out, GUARD_NAME_MAX + 1, is_address(name, AF_INET6) ? "[%s]" : "%s", name);
    for (; *out; out++)
        *out = (char)tolower((unsigned char)*out);
    guard->name_count++;
}

int guard_is_loopback(const char *host)
{
    return strcasecmp(host, "localhost") == 0 || strcmp(host, "::1") == 0 ||
           (strncmp(host, "127.", 4) == 0 && is_address(host, AF_INET));
}

status guard_init(struct guard *guard, const char *host, const char *name, uint16_t port, int is_tls, struct error *err)
{
    char own[GUARD_NAME_MAX + 1] = "";

    *guard = (struct guard){.port = port, .is_tls = is_tls};
    if (name && !is_name(name) && !is_address(name, AF_INET6))
        return error_set(err, STATUS_ERR_USAGE,
                         "--web-name '%s' is not a name: give it without 'https://' and without a port", name);
    guard->any_address = !host[0] || strcmp(host, "0.0.0.0") == 0 || strcmp(host, "::") == 0;
    if (guard->any_address || guard_is_loopback(host)) {
        add_name(guard, "localhost");
        add_name(guard, "127.0.0.1");
        add_name(guard, "::1");
    }
    if (guard->any_address && gethostname(own, sizeof own - 1) == 0 && is_name(own))
        add_name(guard, own);
    if (!guard->any_address)
        add_name(guard, host);
    if (name)
        add_name(guard, name);
    return STATUS_OK;
}

const char *guard_public_name(const struct guard *guard, const char *host, const char *name)
{
    if (name)
        return name;
    if (!guard->any_address)
        return host;
    return guard->name_count > LOOPBACK_NAMES ? guard->names[LOOPBACK_NAMES] : guard->names[0];
}

/* Is "NAME:PORT" one of ours? */
static int is_ours(const struct guard *guard, const char *text)
{
    char name[GUARD_NAME_MAX + 1], *colon, *end;
    unsigned long port = guard->is_tls ? 443 : 80;

    if (strlen(text) > GUARD_NAME_MAX)
        return 0;
    snprintf(name, sizeof name, "%s", text);
    colon = name[0] == '[' ? strstr(name, "]:") : strchr(name, ':');
    if (colon) {
        colon += name[0] == '[';
        if (!isdigit((unsigned char)colon[1]))
            return 0;
        port = strtoul(colon + 1, &end, 10);
        if (*end)
            return 0;
        *colon = 0;
    }
    if (port != guard->port)
        return 0;
    for (size_t i = 0; i < guard->name_count; i++)
        if (strcasecmp(name, guard->names[i]) == 0)
            return 1;
    return guard->any_address && (is_address(name, AF_INET) || is_bracketed(name));
}

/* ---- a request ------------------------------------------------------------------------------- */

/* The origin of the very host that was asked. */
static int is_own_origin(const struct guard *guard, const char *origin, const char *host)
{
    const char *scheme = guard->is_tls ? "https://" : "http://";
    const size_t size = strlen(scheme);

    return strncmp(origin, scheme, size) == 0 && strcasecmp(origin + size, host) == 0;
}

unsigned guard_check(const struct guard *guard, const struct guard_headers_of *request, struct error *why)
{
    const int is_foreign_site = request->fetch_site && strcmp(request->fetch_site, "same-origin") != 0 &&
                                strcmp(request->fetch_site, "none") != 0;

    if (!request->host || !is_ours(guard, request->host)) {
        (void)error_set(why, STATUS_ERR_REFUSED,
                        "the page is not served under this name: use the address that the coordinator printed, "
                        "or start it with --web-name");
        return 421;
    }
    if (request->changes || request->is_socket) {
        if (request->origin ? !is_own_origin(guard, request->origin, request->host) : request->by_cookie) {
            (void)error_set(why, STATUS_ERR_REFUSED, "a page of another origin may not do this");
            return 403;
        }
    }
    if (request->is_api && is_foreign_site &&
        (request->changes || request->is_socket || !request->fetch_mode || strcmp(request->fetch_mode, "navigate") != 0)) {
        (void)error_set(why, STATUS_ERR_REFUSED, "a page of another site may not ask this");
        return 403;
    }
    return 0;
}

/* ---- tokens ---------------------------------------------------------------------------------- */

static int is_token_character(char c) { return isalnum((unsigned char)c) || (c && strchr("-._~+/=", c)); }

static int take_token(const char *from, size_t size, char *out)
{
    if (size == 0 || size > GUARD_TOKEN_MAX)
        return 0;
    for (size_t i = 0; i < size; i++)
        if (!is_token_character(from[i]))
            return 0;
    memcpy(out, from, size);
    out[size] = 0;
    return 1;
}

int guard_bearer(const char *authorization, char *out)
{
    out[0] = 0;
    if (!authorization || strncasecmp(authorization, "Bearer ", 7) != 0)
        return 0;
    authorization += 7;
    authorization += strspn(authorization, " ");
    return take_token(authorization, strcspn(authorization, " "), out);
}

int guard_cookie(const char *cookies, uint16_t port, char *out)
{
    char ours[sizeof GUARD_COOKIE + 5 + 1]; /* a port and "=" */
    size_t size;

    out[0] = 0;
    snprintf(ours, sizeof ours, GUARD_COOKIE "%u=", port);
    size = strlen(ours);
    for (const char *at = cookies; at && *at;) {
        at += strspn(at, "; ");
        if (strncmp(at, ours, size) == 0)
            return take_token(at + size, strcspn(at + size, "; "), out);
        at += strcspn(at, ";");
    }
    return 0;
}
