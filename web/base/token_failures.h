/* token_failures: which addresses sent wrong tokens lately. */
#pragma once

#include <stdint.h>

enum {
    TOKEN_FAILURES_MAX = 20,        /* wrong tokens of one address in TOKEN_FAILURES_S; the rest is */
    TOKEN_FAILURES_S = 60,          /* answered 429 and is not in the audit log */
    TOKEN_ADDRESSES_MAX = 256,      /* that are remembered, the newest */
};

/* Zeroed. */
struct token_failures {
    struct token_failure {
        char address[64];
        uint64_t since_ns, last_ns;
        uint32_t count;
    } of[TOKEN_ADDRESSES_MAX];
};

/* Note one of "10.0.0.7:512", whose port does not count. 0: the address sent too many. */
int token_failures_note(struct token_failures *failures, const char *peer, uint64_t now_ns);
