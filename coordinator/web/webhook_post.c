#include "coordinator/web/webhook_post.h"

#include <curl/curl.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/base/clock.h"

enum { ANSWER_MAX = 64 << 10 }; /* of an answer, which nobody reads */

/* ---- the address -------------------------------------------------------------------------------- */

static int has_only_printable(const char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text <= ' ' || (unsigned char)*text >= 0x7f)
            return 0;
    return 1;
}

/* libcurl also takes "http:/a" and "http:///a". */
static int has_two_slashes(const char *url)
{
    const char *slashes = strstr(url, "://");

    return slashes && slashes[3] != '/';
}

status webhook_check_url(const char *url, struct error *err)
{
    CURLU *parts = curl_url();
    char *scheme = NULL, *host = NULL;
    int fits;

    if (!parts)
        return error_no_memory(err, "a webhook's address");
    fits = strlen(url) <= WEBHOOK_URL_MAX && has_only_printable(url) && has_two_slashes(url) &&
           curl_url_set(parts, CURLUPART_URL, url, 0) == CURLUE_OK &&
           curl_url_get(parts, CURLUPART_SCHEME, &scheme, 0) == CURLUE_OK &&
           curl_url_get(parts, CURLUPART_HOST, &host, 0) == CURLUE_OK && host[0] &&
           (strcmp(scheme, "http") == 0 || strcmp(scheme, "https") == 0);
    curl_free(scheme);
    curl_free(host);
    curl_url_cleanup(parts);
    if (fits)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_INPUT,
                     "a webhook's address is http://HOST/PATH or https://HOST/PATH, at most %d printable characters "
                     "without spaces",
                     WEBHOOK_URL_MAX);
}

static uint16_t port_of(const struct sockaddr *address)
{
    return ntohs(address->sa_family == AF_INET6 ? ((const struct sockaddr_in6 *)address)->sin6_port
                                                : ((const struct sockaddr_in *)address)->sin_port);
}

/* Only an address of this machine can be bound. */
static int is_here(const struct sockaddr *address, socklen_t size)
{
    struct sockaddr_storage any = {0};
    int fd = socket(address->sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0), here;

    memcpy(&any, address, size < sizeof any ? size : sizeof any);
    if (any.ss_family == AF_INET6)
        ((struct sockaddr_in6 *)&any)->sin6_port = 0;
    else
        ((struct sockaddr_in *)&any)->sin_port = 0;
    here = fd >= 0 && bind(fd, (struct sockaddr *)&any, size) == 0;
    if (fd >= 0)
        close(fd);
    return here;
}

/* A request, as libcurl's callbacks know it. */
struct sending {
    const struct webhook_post *post;
    int refused;
    size_t answer_bytes;
};

/* After the name was resolved: by no name does a webhook reach the coordinator. */
static curl_socket_t open_socket(void *user, curlsocktype purpose, struct curl_sockaddr *address)
{
    struct sending *sending = user;
    uint16_t port = port_of(&address->addr);

    (void)purpose;
    if (port && (port == sending->post->own_ports[0] || port == sending->post->own_ports[1]) &&
        is_here(&address->addr, address->addrlen)) {
        sending->refused = 1;
        return CURL_SOCKET_BAD;
    }
    return socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

/* ---- what is sent ------------------------------------------------------------------------------- */

status webhook_body(char out[WEBHOOK_BODY_MAX], const char *event, const char *fields, struct error *err)
{
    uint8_t random[8];
    uint64_t delivery;
    int length;

    if (RAND_bytes(random, sizeof random) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL has no random numbers for an event");
    memcpy(&delivery, random, sizeof delivery);
    length = snprintf(out, WEBHOOK_BODY_MAX, "{\"event\": \"%s\", \"delivery\": \"%016" PRIx64 "\", \"at\": %" PRId64 ", %s}",
                      event, delivery, clock_wall_s(), fields);
    return length < WEBHOOK_BODY_MAX ? STATUS_OK
                                     : error_set(err, STATUS_ERR_LIMIT, "it has more than %d bytes", WEBHOOK_BODY_MAX);
}

status webhook_sign(char out[WEBHOOK_SIGNATURE_SIZE], const struct webhook_row *row, int64_t at, const char *body,
                    struct error *err)
{
    char text[32 + WEBHOOK_BODY_MAX], key[DIGEST_HEX_SIZE];
    struct digest mac, secret;
    unsigned size = sizeof mac.bytes;
    int length = snprintf(text, sizeof text, "%" PRId64 ".%s", at, body);

    _Static_assert(sizeof secret.bytes == sizeof row->secret, "a secret is shown as a digest is");
    memcpy(secret.bytes, row->secret, sizeof secret.bytes);
    digest_to_hex(&secret, key);
    if (length < 0 || (size_t)length >= sizeof text ||
        !HMAC(EVP_sha256(), key, (int)strlen(key), (const uint8_t *)text, (size_t)length, mac.bytes, &size))
        return error_set(err, STATUS_ERR_INTERNAL, "an event cannot be signed");
    memcpy(out, "sha256=", 7);
    digest_to_hex(&mac, out + 7);
    return STATUS_OK;
}

static struct curl_slist *make_headers(const struct webhook_row *row, const char *body, struct error *err)
{
    char signature[WEBHOOK_SIGNATURE_SIZE], lines[2][160];
    int64_t at = clock_wall_s();
    const char *all[] = {lines[0], lines[1], "Content-Type: application/json", "Expect:"};
    struct curl_slist *headers = NULL;

    if (webhook_sign(signature, row, at, body, err) != STATUS_OK)
        return NULL;
    snprintf(lines[0], sizeof lines[0], "X-Azulejo-Timestamp: %" PRId64, at);
    snprintf(lines[1], sizeof lines[1], "X-Azulejo-Signature: %s", signature);
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        struct curl_slist *more = curl_slist_append(headers, all[i]);
        if (!more) {
            curl_slist_free_all(headers);
            (void)error_no_memory(err, "a webhook's request");
            return NULL;
        }
        headers = more;
    }
    return headers;
}

/* ---- sending ------------------------------------------------------------------------------------ */

static size_t on_answer(char *data, size_t one, size_t size, void *user)
{
    struct sending *sending = user;

    (void)data, (void)one;
    sending->answer_bytes += size;
    return sending->answer_bytes <= ANSWER_MAX ? size : 0;
}

static int on_progress(void *user, curl_off_t all_in, curl_off_t in, curl_off_t all_out, curl_off_t out)
{
    const struct sending *sending = user;

    (void)all_in, (void)in, (void)all_out, (void)out;
    return atomic_load(sending->post->ending);
}

static void set_options(CURL *curl, struct sending *sending, const struct webhook_row *row, const char *body,
                        struct curl_slist *headers)
{
    curl_easy_setopt(curl, CURLOPT_URL, row->url);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_FOLLOWLOCATION, 0L);
    curl_easy_setopt(curl, CURLOPT_PROXY, "");
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, (long)WEBHOOK_CONNECT_S);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT, (long)WEBHOOK_TIMEOUT_S);
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "azulejo/" AZULEJO_VERSION);
    curl_easy_setopt(curl, CURLOPT_POST, 1L);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE, (long)strlen(body));
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_OPENSOCKETFUNCTION, open_socket);
    curl_easy_setopt(curl, CURLOPT_OPENSOCKETDATA, sending);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, on_answer);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, sending);
    curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, on_progress);
    curl_easy_setopt(curl, CURLOPT_XFERINFODATA, sending);
    curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
}

static status result_of(CURL *curl, CURLcode code, const struct sending *sending, struct error *err)
{
    long http = 0;

    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &http);
    if (sending->refused)
        return error_set(err, STATUS_ERR_REFUSED, "its address is the coordinator's own, to which no webhook is sent");
    if (code != CURLE_OK && code != CURLE_WRITE_ERROR) /* which is ours: an answer that is too long */
        return error_set(err, STATUS_ERR_UNREACHABLE, "%s", curl_easy_strerror(code));
    if (http >= 300 && http < 400)
        return error_set(err, STATUS_ERR_UNREACHABLE,
                         "the server answered %ld; redirects are not followed: give the address that it points to", http);
    if (http < 200 || http >= 300)
        return error_set(err, STATUS_ERR_UNREACHABLE, "the server answered %ld", http);
    return STATUS_OK;
}

status webhook_post(const struct webhook_post *post, const struct webhook_row *row, const char *body,
                    struct error *err)
{
    struct sending sending = {.post = post};
    CURL *curl = curl_easy_init();
    struct curl_slist *headers = curl ? make_headers(row, body, err) : NULL;
    status s = STATUS_ERR_INTERNAL;

    if (!curl)
        return error_no_memory(err, "a webhook's request");
    if (headers) {
        set_options(curl, &sending, row, body, headers);
        s = result_of(curl, curl_easy_perform(curl), &sending, err);
    } else if (err) {
        s = err->code;
    }
    curl_slist_free_all(headers);
    curl_easy_cleanup(curl);
    return s;
}
