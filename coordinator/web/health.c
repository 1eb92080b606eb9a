#include "coordinator/web/health.h"

/* That this is sent is the answer: the loop runs. */
void web_healthz(struct web_request *request)
{
    web_answer(request, 200, "text/plain; charset=utf-8", NULL, "ok\n", 3);
}
