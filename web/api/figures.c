#include "web/api/figures.h"

#include <stdio.h>

#include "protocol/message.h"
#include "protocol/metric_text.h"
#include "web/api/call.h"
#include "web/http/http.h"
#include "web/base/problem.h"
#include "web/web.h"

static void put_own(struct buffer *out, const struct web *web)
{
    struct http_counts counts = http_counts(web->http);
    char code[16];

    metric_begin(out, "azulejo_web_requests_total", "counter", "Answered requests of the page and the API, by code.");
    for (int i = 1; i < 6; i++) {
        snprintf(code, sizeof code, "%dxx", i);
        metric_value(out, "azulejo_web_requests_total", (double)counts.answers[i], "code", code, NULL);
    }
    metric_one(out, "azulejo_web_refused_total", "counter", "Connections of browsers and programs beyond the limit.",
               (double)counts.answers[0]);
    metric_one(out, "azulejo_web_connections", "gauge", "Connections to the page and the API.", counts.connections);
    metric_one(out, "azulejo_web_sockets", "gauge", "WebSockets among them.", counts.sockets);
    metric_one(out, "azulejo_web_wrong_tokens_total", "counter", "Requests with a wrong token.",
               (double)web->callers.failure_count);
}

static void on_metrics(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    struct buffer text = BUFFER_INIT;

    if (answer->body_case == AZULEJO__WIRE__ENVELOPE__BODY_METRICS)
        buffer_puts(&text, answer->metrics->text);
    put_own(&text, request->web);
    if (buffer_ok(&text))
        web_answer(request, 200, METRIC_CONTENT_TYPE, NULL, text.data, text.size);
    else
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for the metrics");
    buffer_release(&text);
}

void web_metrics(struct web_request *request)
{
    Azulejo__Wire__MetricsGet get = AZULEJO__WIRE__METRICS_GET__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(METRICS_GET, metrics_get, &get);
    struct error err = {0};

    if (web_call_send(request, &envelope, WEB_CALL_SHARED, on_metrics, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
}
