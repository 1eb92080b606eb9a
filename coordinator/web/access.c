#include "coordinator/web/access.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/base/clock.h"
#include "common/base/json_quote.h"
#include "coordinator/net/server.h"
#include "coordinator/store/audit.h"
#include "coordinator/web/tokens.h"
#include "coordinator/web/web.h"

void access_note(struct web *web, const char *who, const char *peer, const struct token_row *row,
                 const struct error *why)
{
    struct audit_actor actor = {.key = "token"};
    char name[JSON_QUOTE_SIZE(TOKEN_NAME_MAX)] = "", details[sizeof name + 64];

    snprintf(actor.who, sizeof actor.who, "%s", who);
    snprintf(actor.address, sizeof actor.address, "%s", peer);
    if (row) {
        json_quote(name, row->name, TOKEN_NAME_MAX);
        snprintf(details, sizeof details, "{\"token\": %" PRIu64 ", \"name\": %s}", row->number, name);
    }
    audit_note(&web->server->audit, &actor, "sign in", 0, row ? details : NULL, why);
}

int access_note_failure(struct web *web, const char *peer)
{
    struct error why;

    if (!web_tokens_note_failure(web->tokens, peer, clock_monotonic_ns()))
        return 0;
    (void)error_set(&why, STATUS_ERR_REFUSED, "the token is wrong, revoked or expired");
    access_note(web, "", peer, NULL, &why);
    return 1;
}
