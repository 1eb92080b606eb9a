#include "coordinator/web/health.h"

#include <errno.h>
#include <string.h>

#include "coordinator/net/server.h"
#include "coordinator/web/web.h"

static void say(struct web_request *request, unsigned code, const char *text)
{
    web_answer(request, code, "text/plain; charset=utf-8", NULL, text, strlen(text));
}

/* That this is sent is the answer: the loop runs. */
void web_healthz(struct web_request *request)
{
    say(request, 200, "ok\n");
}

/* What is wrong with the store may name paths: only those with a token read them. */
static void say_store(struct web_request *request, const struct farm *farm)
{
    struct buffer text = BUFFER_INIT;

    buffer_puts(&text, "the store cannot be used");
    if (request->caller.role >= WEB_ROLE_VIEW)
        buffer_printf(&text, ": %s", farm->trouble.text);
    else if (strstr(farm->trouble.text, strerror(ENOSPC)))
        buffer_puts(&text, ": its disk is full");
    buffer_puts(&text, "\n");
    say(request, 503, buffer_text(&text));
    buffer_release(&text);
}

void web_readyz(struct web_request *request)
{
    const struct server *server = request->web->server;

    if (server->state != SERVER_LISTENING)
        say(request, 503, "the coordinator is ending\n");
    else if (trouble_is(&server->farm.trouble))
        say_store(request, &server->farm);
    else
        say(request, 200, "ok\n");
}
