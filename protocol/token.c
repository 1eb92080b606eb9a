#include "protocol/token.h"

#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <string.h>

#define PREFIX "azt_" /* so that programs that look for secrets in files know what it is */
enum { PREFIX_LENGTH = sizeof PREFIX - 1 };

status token_text_hash(const char *text, struct digest *out, struct error *err)
{
    status s = digest_of(out, text, strlen(text));

    return s == STATUS_OK ? s : error_set(err, s, "a token's SHA-256 cannot be computed");
}

status token_text_make(char out[TOKEN_TEXT_SIZE], struct error *err)
{
    struct digest random;

    if (RAND_bytes(random.bytes, sizeof random.bytes) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL has no random numbers for a token");
    memcpy(out, PREFIX, PREFIX_LENGTH);
    digest_to_hex(&random, out + PREFIX_LENGTH);
    OPENSSL_cleanse(&random, sizeof random);
    return STATUS_OK;
}

int token_text_is(const char *text)
{
    struct digest bytes;

    return strlen(text) == TOKEN_TEXT_SIZE - 1 && strncmp(text, PREFIX, PREFIX_LENGTH) == 0 &&
           digest_from_hex(&bytes, text + PREFIX_LENGTH) == STATUS_OK;
}
