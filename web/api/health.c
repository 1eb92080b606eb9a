#include "web/api/health.h"

#include <errno.h>
#include <string.h>

#include "protocol/message.h"
#include "web/api/call.h"

static void say(struct web_request *request, unsigned code, const char *text)
{
    web_answer(request, code, "text/plain; charset=utf-8", NULL, text, strlen(text));
}

/* What is wrong with the store may name paths: only those with a token read them. */
static void say_store(struct web_request *request, const char *why)
{
    struct buffer text = BUFFER_INIT;

    if (request->caller.role >= WEB_ROLE_VIEW)
        buffer_printf(&text, "%s\n", why);
    else
        buffer_printf(&text, "the store cannot be used%s\n", strstr(why, strerror(ENOSPC)) ? ": its disk is full" : "");
    say(request, 503, buffer_text(&text));
    buffer_release(&text);
}

static void on_ready(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    const Azulejo__Wire__FarmInfo *farm = answer->farm_info;

    if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_FARM_INFO || farm->ending)
        say(request, 503, "the coordinator is ending\n");
    else if (!farm->store_usable)
        say_store(request, farm->store_why);
    else
        say(request, 200, "ok\n");
}

/* That it answers is the answer: its loop runs. */
static void on_alive(struct web_request *request, const Azulejo__Wire__Envelope *answer UNUSED)
{
    say(request, 200, "ok\n");
}

static void ask(struct web_request *request, web_call_answer *on_answer)
{
    Azulejo__Wire__FarmQuery query = AZULEJO__WIRE__FARM_QUERY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(FARM_QUERY, farm_query, &query);

    if (web_call_send(request, &envelope, WEB_CALL_SHARED, on_answer, NULL) != STATUS_OK)
        say(request, 503, "the coordinator does not answer\n");
}

void web_healthz(struct web_request *request) { ask(request, on_alive); }

void web_readyz(struct web_request *request) { ask(request, on_ready); }
