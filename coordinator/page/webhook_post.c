#include "coordinator/page/webhook_post.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/base/buffer.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/page/keeper.h"

extern char **environ;

enum {
    WORDS_MAX = 256,             /* of why it was not taken */
    LOOK_MS = 100,               /* is it to be broken off? */
    SPARE_S = 1,                 /* beyond the request's own limit */
    PORT_MAX = 65535,
};

/* ---- the address -------------------------------------------------------------------------------- */

static int has_only_printable(const char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text <= ' ' || (unsigned char)*text >= 0x7f)
            return 0;
    return 1;
}

/* ":PORT", or nothing. */
static int is_port(const char *text, size_t length)
{
    char digits[8] = "";

    if (length == 0)
        return 1;
    if (text[0] != ':' || length < 2 || length > 6 || strspn(text + 1, "0123456789") < length - 1)
        return 0;
    memcpy(digits, text + 1, length - 1);
    return strtoul(digits, NULL, 10) <= PORT_MAX;
}

/* [USER@]HOST[:PORT], as in what stands between the slashes. */
static int is_authority(const char *text, size_t length)
{
    const char *at = memchr(text, '@', length), *end;
    size_t host;

    if (at) {
        length -= (size_t)(at + 1 - text);
        text = at + 1;
    }
    if (length > 0 && text[0] == '[') {
        end = memchr(text, ']', length);
        host = end ? (size_t)(end + 1 - text) : 0;
        return host > 2 && strspn(text + 1, "0123456789abcdefABCDEF:.") == host - 2 && is_port(text + host, length - host);
    }
    host = strcspn(text, ":");
    if (host > length)
        host = length;
    return host > 0 && is_port(text + host, length - host);
}

status webhook_check_url(const char *url, struct error *err)
{
    size_t scheme = strncasecmp(url, "http://", 7) == 0 ? 7 : strncasecmp(url, "https://", 8) == 0 ? 8 : 0;

    if (scheme && strlen(url) <= WEBHOOK_URL_MAX && has_only_printable(url) &&
        is_authority(url + scheme, strcspn(url + scheme, "/?#")))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_INPUT,
                     "a webhook's address is http://HOST/PATH or https://HOST/PATH, at most %d printable characters "
                     "without spaces",
                     WEBHOOK_URL_MAX);
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

/* What `azulejo-web post` reads. */
static status put_request(struct buffer *out, const struct webhook_post *post, const struct webhook_row *row,
                          const char *body, struct error *err)
{
    char signature[WEBHOOK_SIGNATURE_SIZE];
    int64_t at = clock_wall_s();

    TRY(webhook_sign(signature, row, at, body, err));
    buffer_printf(out, "%u %u\n%s\n%" PRId64 "\n%s\n%s", post->own_ports[0], post->own_ports[1], row->url, at,
                  signature, body);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a webhook's request");
}

/* ---- the process -------------------------------------------------------------------------------- */

struct poster {
    pid_t process;
    int input, output; /* ends of pipes; -1: closed */
};

static void close_end(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

/* 0, or an errno. */
static int spawn(struct poster *poster, const char *program, int input, int output)
{
    char *words[] = {(char *)"azulejo-web", (char *)"post", NULL};
    posix_spawn_file_actions_t files;
    int code = posix_spawn_file_actions_init(&files);

    if (code != 0)
        return code;
    code = posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
    if (code == 0)
        code = posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
    if (code == 0)
        code = posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
    if (code == 0)
        code = posix_spawn(&poster->process, program, &files, NULL, words, environ);
    posix_spawn_file_actions_destroy(&files);
    return code;
}

static status begin(struct poster *poster, struct error *err)
{
    int in[2] = {-1, -1}, out[2] = {-1, -1}, code = 0;
    char *program = keeper_program();

    *poster = (struct poster){.input = -1, .output = -1};
    if (!program || pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0)
        code = program ? errno : ENOMEM;
    if (code == 0)
        code = spawn(poster, program, in[0], out[1]);
    close_end(&in[0]);
    close_end(&out[1]);
    poster->input = in[1];
    poster->output = out[0];
    if (code != 0) {
        (void)error_set(err, STATUS_ERR_UNREACHABLE, "%s cannot be run: %s", program ? program : "azulejo-web",
                        strerror(code));
        close_end(&poster->input);
        close_end(&poster->output);
    }
    mem_free(program);
    return code == 0 ? STATUS_OK : STATUS_ERR_UNREACHABLE;
}

/* What it says, until it ends. 0: it must be ended. */
static int listen(const struct poster *poster, const atomic_int *ending, char words[WORDS_MAX])
{
    uint64_t until_ns = clock_monotonic_ns() + (WEBHOOK_TIMEOUT_S + SPARE_S) * NS_PER_SECOND;
    size_t size = 0;

    for (;;) {
        struct pollfd look = {.fd = poster->output, .events = POLLIN};
        char more[WORDS_MAX];
        ssize_t got;
        if (atomic_load(ending) || clock_monotonic_ns() >= until_ns)
            return 0;
        if (poll(&look, 1, LOOK_MS) <= 0)
            continue;
        got = read(poster->output, more, sizeof more);
        if (got <= 0)
            return 1;
        if ((size_t)got > WORDS_MAX - 1 - size)
            got = (ssize_t)(WORDS_MAX - 1 - size);
        memcpy(words + size, more, (size_t)got);
        size += (size_t)got;
        words[size] = 0;
    }
}

status webhook_post(const struct webhook_post *post, const struct webhook_row *row, const char *body, struct error *err)
{
    struct buffer request = BUFFER_INIT;
    char words[WORDS_MAX] = "";
    struct poster poster;
    int ended, result = 0, fits;
    status s = put_request(&request, post, row, body, err);

    THEN(s, begin(&poster, err));
    if (s != STATUS_OK) {
        buffer_release(&request);
        return s;
    }
    /* A pipe takes it at once: it is smaller than a pipe. */
    fits = write(poster.input, request.data, request.size) == (ssize_t)request.size;
    buffer_release(&request);
    close_end(&poster.input);
    ended = fits && listen(&poster, post->ending, words);
    close_end(&poster.output);
    if (!ended)
        (void)kill(poster.process, SIGKILL);
    while (waitpid(poster.process, &result, 0) < 0 && errno == EINTR)
        ;
    words[strcspn(words, "\n")] = 0;
    if (ended && WIFEXITED(result) && WEXITSTATUS(result) == 0)
        return STATUS_OK;
    if (ended && WIFEXITED(result) && WEXITSTATUS(result) == status_exit_code(STATUS_ERR_REFUSED))
        return error_set(err, STATUS_ERR_REFUSED, "%s", words);
    return error_set(err, STATUS_ERR_UNREACHABLE, "%s", words[0] ? words : "azulejo-web, which sends it, has ended");
}
