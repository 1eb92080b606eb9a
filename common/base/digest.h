/* digest: SHA-256 (OpenSSL's EVP), the name of every blob. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum { DIGEST_BYTES = 32, DIGEST_HEX_SIZE = 65 };

struct digest {
    uint8_t bytes[DIGEST_BYTES];
};

status digest_of(struct digest *out, const void *data, size_t size_bytes) MUST_CHECK;

/* For data that arrives in pieces. digest_stream_final frees the stream. */
struct digest_stream;
struct digest_stream *digest_stream_new(void); /* NULL when out of memory */
status digest_stream_add(struct digest_stream *s, const void *data, size_t size_bytes) MUST_CHECK;
status digest_stream_final(struct digest_stream *s, struct digest *out) MUST_CHECK;
void digest_stream_free(struct digest_stream *s);

/* Of a file's bytes, of which there are *size_bytes. ERR_NOT_FOUND if there is no file, ERR_IO. */
status digest_of_file(struct digest *out, uint64_t *size_bytes, const char *path, struct error *err) MUST_CHECK;

int digest_equal(const struct digest *a, const struct digest *b);

/* 64 hexadecimal digits and a NUL into `hex`. */
void digest_to_hex(const struct digest *d, char hex[DIGEST_HEX_SIZE]);

/* ERR_INPUT unless `hex` is exactly 64 hexadecimal digits. */
status digest_from_hex(struct digest *out, const char *hex) MUST_CHECK;
