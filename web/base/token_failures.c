#include "web/base/token_failures.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"

/* The address's place; if it has none, that of the one that failed least recently. */
static struct token_failure *failure_of(struct token_failures *failures, const char *peer)
{
    struct token_failure *oldest = &failures->of[0];
    const char *port = strrchr(peer, ':');
    char address[sizeof oldest->address];

    snprintf(address, sizeof address, "%.*s", port ? (int)(port - peer) : (int)strlen(peer), peer);
    for (size_t i = 0; i < TOKEN_ADDRESSES_MAX; i++) {
        struct token_failure *f = &failures->of[i];
        if (strcmp(f->address, address) == 0)
            return f;
        if (f->last_ns < oldest->last_ns)
            oldest = f;
    }
    *oldest = (struct token_failure){0};
    memcpy(oldest->address, address, sizeof address);
    return oldest;
}

int token_failures_note(struct token_failures *failures, const char *peer, uint64_t now_ns)
{
    struct token_failure *f = failure_of(failures, peer);

    if (f->count == 0 || now_ns - f->since_ns >= TOKEN_FAILURES_S * NS_PER_SECOND) {
        f->count = 0;
        f->since_ns = now_ns;
    }
    f->last_ns = now_ns;
    f->count += f->count <= TOKEN_FAILURES_MAX;
    return f->count <= TOKEN_FAILURES_MAX;
}
