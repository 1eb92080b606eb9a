/* certificate: the one that the page has beyond this machine, if none is named: self-signed, made on first use
 * and kept in the store, so that its fingerprint stays what people compared once.
 */
#pragma once

#include <stddef.h>

#include "common/base/status.h"

enum {
    CERTIFICATE_DAYS = 825,       /* what browsers take at most */
    CERTIFICATE_SPARE_DAYS = 30,  /* one that ends sooner than this is replaced at the next start */
    FINGERPRINT_SIZE = 3 * 32,    /* "AB:CD:...", SHA-256 of the DER form */
};

/* Make both files (the key 0600) unless they hold a certificate of ours that is good for `name`, a host name or
 * an IP address, for some time. *made: 1 if so. ERR_IO, ERR_INTERNAL. */
status certificate_ensure(const char *cert_path, const char *key_path, const char *name, int *made,
                          struct error *err) MUST_CHECK;
/* The fingerprint of the file's first certificate. ERR_INPUT: it holds none; ERR_IO. */
status certificate_fingerprint(const char *cert_path, char out[FINGERPRINT_SIZE], struct error *err) MUST_CHECK;
