#include "web/post.h"

#include <curl/curl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/base/status.h"

enum {
    ANSWER_MAX = 64 << 10,       /* of an answer, which is not read */
    POST_CONNECT_S = 5,
    POST_TIMEOUT_S = 10,         /* of a whole request */
    INPUT_MAX = 16 << 10,
};

/* What the input says, in its own text. */
struct request {
    unsigned own_ports[2];
    char *url, *timestamp, *signature, *body;
};

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
    unsigned own_ports[2];
    const char *refused; /* why; NULL: it was not */
    size_t answer_bytes;
};

/* 169.254.0.0/16 and fe80::/10: where clouds serve a machine's own keys. */
static int is_link_local(const struct sockaddr *address)
{
    const struct in6_addr *six = &((const struct sockaddr_in6 *)address)->sin6_addr;

    if (address->sa_family == AF_INET6)
        return IN6_IS_ADDR_LINKLOCAL(six) ||
               (IN6_IS_ADDR_V4MAPPED(six) && six->s6_addr[12] == 169 && six->s6_addr[13] == 254);
    return ntohl(((const struct sockaddr_in *)address)->sin_addr.s_addr) >> 16 == (169 << 8 | 254);
}

/* After the name was resolved: by no name does a webhook reach the coordinator. */
static curl_socket_t open_socket(void *user, curlsocktype purpose UNUSED, struct curl_sockaddr *address)
{
    struct sending *sending = user;
    uint16_t port = port_of(&address->addr);

    if (port && (port == sending->own_ports[0] || port == sending->own_ports[1]) &&
        is_here(&address->addr, address->addrlen)) {
        sending->refused = "its address is the coordinator's own, to which no webhook is sent";
        return CURL_SOCKET_BAD;
    }
    if (is_link_local(&address->addr)) {
        sending->refused = "its address is link-local, to which no webhook is sent";
        return CURL_SOCKET_BAD;
    }
    return socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

/* ---- what is sent ------------------------------------------------------------------------------- */

static struct curl_slist *make_headers(const struct request *request)
{
    char lines[2][160];
    const char *all[] = {lines[0], lines[1], "Content-Type: application/json", "Expect:"};
    struct curl_slist *headers = NULL;

    snprintf(lines[0], sizeof lines[0], "X-Azulejo-Timestamp: %.40s", request->timestamp);
    snprintf(lines[1], sizeof lines[1], "X-Azulejo-Signature: %.100s", request->signature);
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        struct curl_slist *more = curl_slist_append(headers, all[i]);
        if (!more) {
            curl_slist_free_all(headers);
            return NULL;
        }
        headers = more;
    }
    return headers;
}

/* ---- sending ------------------------------------------------------------------------------------ */

static size_t on_answer(char *data UNUSED, size_t one UNUSED, size_t size, void *user)
{
    struct sending *sending = user;

    sending->answer_bytes += size;
    return sending->answer_bytes <= ANSWER_MAX ? size : 0;
}

static void set_options(CURL *curl, struct sending *sending, const struct request *request, struct curl_slist *headers)
{
    curl_easy_setopt(curl, CURLOPT_URL, request->url);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_FOLLOWLOCATION, 0L);
    curl_easy_setopt(curl, CURLOPT_PROXY, "");
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, (long)POST_CONNECT_S);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT, (long)POST_TIMEOUT_S);
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "azulejo/" AZULEJO_VERSION);
    curl_easy_setopt(curl, CURLOPT_POST, 1L);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, request->body);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE, (long)strlen(request->body));
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_OPENSOCKETFUNCTION, open_socket);
    curl_easy_setopt(curl, CURLOPT_OPENSOCKETDATA, sending);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, on_answer);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, sending);
}

static status result_of(CURL *curl, CURLcode code, const struct sending *sending, struct error *err)
{
    long http = 0;

    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &http);
    if (sending->refused)
        return error_set(err, STATUS_ERR_REFUSED, "%s", sending->refused);
    if (code != CURLE_OK && code != CURLE_WRITE_ERROR) /* which is ours: an answer that is too long */
        return error_set(err, STATUS_ERR_UNREACHABLE, "%s", curl_easy_strerror(code));
    if (http >= 300 && http < 400)
        return error_set(err, STATUS_ERR_UNREACHABLE,
                         "the server answered %ld; redirects are not followed: give the address that it points to", http);
    if (http < 200 || http >= 300)
        return error_set(err, STATUS_ERR_UNREACHABLE, "the server answered %ld", http);
    return STATUS_OK;
}

static status send_request(const struct request *request, struct error *err)
{
    struct sending sending = {.own_ports = {request->own_ports[0], request->own_ports[1]}};
    CURL *curl = curl_easy_init();
    struct curl_slist *headers = curl ? make_headers(request) : NULL;
    status s = STATUS_ERR_NO_MEMORY;

    if (headers) {
        set_options(curl, &sending, request, headers);
        s = result_of(curl, curl_easy_perform(curl), &sending, err);
    } else {
        (void)error_no_memory(err, "a webhook's request");
    }
    curl_slist_free_all(headers);
    curl_easy_cleanup(curl);
    return s;
}

/* ---- the program -------------------------------------------------------------------------------- */

/* The rest of the line at *at, which goes on to the next; NULL: there is none. */
static char *take_line(char **at)
{
    char *line = *at, *end = strchr(line, '\n');

    if (!end)
        return NULL;
    *end = 0;
    *at = end + 1;
    return line;
}

static status read_request(char *text, struct request *out, struct error *err)
{
    char *ports = take_line(&text);

    out->url = ports ? take_line(&text) : NULL;
    out->timestamp = out->url ? take_line(&text) : NULL;
    out->signature = out->timestamp ? take_line(&text) : NULL;
    out->body = text;
    if (!out->signature || sscanf(ports, "%u %u", &out->own_ports[0], &out->own_ports[1]) != 2)
        return error_set(err, STATUS_ERR_USAGE, "'azulejo-web post' reads what the coordinator writes");
    return STATUS_OK;
}

int web_post_main(void)
{
    char text[INPUT_MAX + 1];
    struct request request;
    struct error err = {0};
    size_t size = fread(text, 1, INPUT_MAX, stdin);
    status s;

    text[size] = 0;
    s = read_request(text, &request, &err);
    if (s == STATUS_OK && curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK)
        s = error_no_memory(&err, "libcurl");
    THEN(s, send_request(&request, &err));
    if (s != STATUS_OK)
        printf("%s\n", err.text);
    return status_exit_code(s);
}
