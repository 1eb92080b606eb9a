#include "common/base/digest.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/evp.h>
#include <string.h>
#include <unistd.h>

#include "common/base/memory.h"

struct digest_stream {
    EVP_MD_CTX *ctx;
};

status digest_of(struct digest *out, const void *data, size_t size_bytes)
{
    unsigned length = 0;

    memset(out, 0, sizeof *out);
    if (EVP_Digest(data, size_bytes, out->bytes, &length, EVP_sha256(), NULL) != 1)
        return STATUS_ERR_INTERNAL;
    return STATUS_OK;
}

struct digest_stream *digest_stream_new(void)
{
    struct digest_stream *s = mem_calloc(1, sizeof *s);

    if (!s)
        return NULL;
    s->ctx = EVP_MD_CTX_new();
    if (!s->ctx || EVP_DigestInit_ex(s->ctx, EVP_sha256(), NULL) != 1) {
        digest_stream_free(s);
        return NULL;
    }
    return s;
}

status digest_stream_add(struct digest_stream *s, const void *data, size_t size_bytes)
{
    return EVP_DigestUpdate(s->ctx, data, size_bytes) == 1 ? STATUS_OK : STATUS_ERR_INTERNAL;
}

status digest_stream_final(struct digest_stream *s, struct digest *out)
{
    unsigned length = 0;
    int ok;

    memset(out, 0, sizeof *out);
    ok = EVP_DigestFinal_ex(s->ctx, out->bytes, &length);
    digest_stream_free(s);
    return ok == 1 ? STATUS_OK : STATUS_ERR_INTERNAL;
}

void digest_stream_free(struct digest_stream *s)
{
    if (!s)
        return;
    EVP_MD_CTX_free(s->ctx);
    mem_free(s);
}

static status add_file(struct digest_stream *s, int fd, uint64_t *size_bytes, const char *path, struct error *err)
{
    uint8_t piece[65536];

    for (;;) {
        ssize_t n = read(fd, piece, sizeof piece);
        if (n == 0)
            return STATUS_OK;
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
        if (digest_stream_add(s, piece, (size_t)n) != STATUS_OK)
            return error_set(err, STATUS_ERR_INTERNAL, "%s: no digest", path);
        *size_bytes += (uint64_t)n;
    }
}

status digest_of_file(struct digest *out, uint64_t *size_bytes, const char *path, struct error *err)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    struct digest_stream *s = NULL;
    status result;

    memset(out, 0, sizeof *out);
    *size_bytes = 0;
    if (fd < 0)
        return error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO, "%s: cannot be read: %s", path,
                         strerror(errno));
    s = digest_stream_new();
    result = s ? add_file(s, fd, size_bytes, path, err) : error_no_memory(err, "a digest");
    close(fd);
    if (result == STATUS_OK)
        result = digest_stream_final(s, out);
    else
        digest_stream_free(s);
    return result;
}

int digest_equal(const struct digest *a, const struct digest *b)
{
    return memcmp(a->bytes, b->bytes, DIGEST_BYTES) == 0;
}

void digest_to_hex(const struct digest *d, char hex[DIGEST_HEX_SIZE])
{
    static const char digits[] = "0123456789abcdef";

    for (int i = 0; i < DIGEST_BYTES; i++) {
        hex[2 * i] = digits[d->bytes[i] >> 4];
        hex[2 * i + 1] = digits[d->bytes[i] & 15];
    }
    hex[2 * DIGEST_BYTES] = 0;
}

static int hex_value(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    if (c >= 'A' && c <= 'F')
        return c - 'A' + 10;
    return -1;
}

status digest_from_hex(struct digest *out, const char *hex)
{
    memset(out, 0, sizeof *out);
    if (strlen(hex) != 2 * DIGEST_BYTES)
        return STATUS_ERR_INPUT;
    for (int i = 0; i < DIGEST_BYTES; i++) {
        int high = hex_value(hex[2 * i]), low = hex_value(hex[2 * i + 1]);
        if (high < 0 || low < 0)
            return STATUS_ERR_INPUT;
        out->bytes[i] = (uint8_t)(high << 4 | low);
    }
    return STATUS_OK;
}
