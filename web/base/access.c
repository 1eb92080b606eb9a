#include "web/base/access.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/system/clock.h"
#include "common/base/json_quote.h"
#include "protocol/message.h"
#include "web/base/control.h"
#include "web/web.h"

void access_note(struct web *web, const char *verb, const char *who, const char *peer, const char *key, uint64_t job,
                 const char *details, const struct error *why)
{
    Azulejo__Wire__PageNote note = AZULEJO__WIRE__PAGE_NOTE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_NOTE, page_note, &note);

    note.verb = (char *)verb;
    note.who = (char *)who;
    note.address = (char *)peer;
    note.key = (char *)key;
    note.job = job;
    note.details = (char *)(details ? details : "");
    note.code = why ? (uint32_t)why->code : 0;
    note.why = (char *)(why ? why->text : "");
    web_tell(web, &envelope);
}

void access_note_sign_in(struct web *web, const char *who, const char *peer, uint64_t token)
{
    char name[JSON_QUOTE_SIZE(WEB_TOKEN_NAME_MAX)], details[sizeof name + 64];

    json_quote(name, callers_name(&web->callers, token), WEB_TOKEN_NAME_MAX);
    snprintf(details, sizeof details, "{\"token\": %" PRIu64 ", \"name\": %s}", token, name);
    access_note(web, "sign in", who, peer, "token", 0, details, NULL);
}

int access_note_failure(struct web *web, const char *peer)
{
    struct error why;

    if (!callers_note_failure(&web->callers, peer, clock_monotonic_ns()))
        return 0;
    (void)error_set(&why, STATUS_ERR_REFUSED, "the token is wrong, revoked or expired");
    access_note(web, "sign in", "", peer, "token", 0, NULL, &why);
    return 1;
}

void access_note_use(struct web *web, uint64_t token)
{
    Azulejo__Wire__PageNote note = AZULEJO__WIRE__PAGE_NOTE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_NOTE, page_note, &note);

    note.token = token;
    if (callers_must_tell(&web->callers, token, clock_wall_s()))
        web_tell(web, &envelope);
}
