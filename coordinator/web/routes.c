#include "coordinator/web/routes.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/schema/verbs.h"
#include "coordinator/net/server.h"
#include "coordinator/web/api_blobs.h"
#include "coordinator/web/api_farm.h"
#include "coordinator/web/api_files.h"
#include "coordinator/web/assets.h"
#include "coordinator/web/call.h"
#include "coordinator/web/health.h"
#include "coordinator/web/metrics.h"
#include "coordinator/web/live.h"
#include "coordinator/web/import.h"
#include "coordinator/web/json_wire.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/sign_in.h"
#include "coordinator/web/tokens.h"
#include "coordinator/web/web.h"

#define BODY(name) AZULEJO__WIRE__ENVELOPE__BODY_##name
/* A message to the farm, and what it answers with. */
#define ASKS(question, reply) .message = BODY(question), .answer = BODY(reply)
/* What is done to a job (common/schema/verbs.h): its owner may. */
#define VERB(NAME, name, ROLE, run, says, ...)                                                                  \
    {WEB_POST, "/api/v1/jobs/{job}/" #name, WEB_ROLE_##ROLE, ASKS(JOB_##NAME, JOB_LIST), .own_jobs_suffice = 1, \
     .summary = says},
#define VARIANT(...)
#define WORKER_VERB(word, says)                                                                                 \
    {WEB_POST, "/api/v1/workers/{name}/" word, WEB_ROLE_OPERATE, ASKS(WORKER_STEER, WORKER_LIST),             \
     .fixed = "verb=" word, .summary = says}

static web_handler events_stream;
static void live_open(struct web_socket *socket);

#define PICTURE(file, what, says)                                                                               \
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/" file, WEB_ROLE_VIEW, ASKS(OUTPUT_GET, OUTPUT_DATA),        \
     .run = api_picture, .fixed = "kind=" what, .summary = says}

static web_handler api_submit;

static const struct web_route routes[] = {
    {WEB_GET, "/", WEB_ROLE_NONE, .run = web_asset_index, .summary = "The page."},
    {WEB_GET, "/assets/{file}", WEB_ROLE_NONE, .run = web_asset, .summary = "A file of the page."},
    {WEB_GET, "/docs/errors", WEB_ROLE_NONE, .run = problem_list, .summary = "The codes of problems, as text."},
    {WEB_POST, "/api/v1/session", WEB_ROLE_NONE, .run = web_session_post, .summary = "Sign in with a token, for a cookie."},
    {WEB_GET, "/api/v1/session", WEB_ROLE_VIEW, .run = web_session_get, .summary = "Tell who asks."},
    {WEB_DELETE, "/api/v1/session", WEB_ROLE_NONE, .run = web_session_delete, .summary = "Sign out: forget the cookie."},
    {WEB_GET, "/healthz", WEB_ROLE_NONE, .run = web_healthz, .summary = "Say that the coordinator is alive."},

    {WEB_GET, "/api/v1/openapi.yaml", WEB_ROLE_VIEW, .run = web_asset_openapi,
     .summary = "This description of the API."},
    {WEB_GET, "/api/v1/farm", WEB_ROLE_VIEW, .run = api_farm, .summary = "Describe the farm: its jobs' states, workers, store."},
    {WEB_GET, "/api/v1/operators", WEB_ROLE_VIEW, .run = api_operators,
     .summary = "List the tone mappers with their parameters."},
    {WEB_GET, "/api/v1/effects", WEB_ROLE_VIEW, .run = api_effects,
     .summary = "The names behind bits and numbers: effects, layers, choices."},

    {WEB_GET, "/api/v1/verbs", WEB_ROLE_VIEW, .run = api_verbs,
     .summary = "What can be done to jobs: paths, roles, arguments, states, and words for people."},

    {WEB_GET, "/api/v1/log", WEB_ROLE_VIEW, ASKS(JOB_LOG_GET, JOB_LOG), .query = "after newest",
     .summary = "Tell what happened to all jobs: after a number, or the newest events."},
    {WEB_GET, "/api/v1/jobs", WEB_ROLE_VIEW, ASKS(JOB_QUERY, JOB_LIST), .query = "filter before first",
     .summary = "List jobs: the newest that match the filter, or with `first` those that are served next."},
    {WEB_POST, "/api/v1/jobs", WEB_ROLE_SUBMIT, ASKS(JOB_SUBMIT, JOB_ACCEPTED), .run = api_submit,
     .summary = "Submit a job whose scene and blobs were sent."},
    {WEB_GET, "/api/v1/jobs/{job}", WEB_ROLE_VIEW, ASKS(JOB_QUERY, JOB_LIST), .summary = "Describe a job."},
    {WEB_DELETE, "/api/v1/jobs/{job}", WEB_ROLE_OPERATE, ASKS(JOB_REMOVE, JOB_LIST), .own_jobs_suffice = 1,
     .query = "unless_read", .summary = "Remove a job that has ended, with its films and pictures."},
    JOB_VERBS(VERB, VARIANT)
    {WEB_GET, "/api/v1/jobs/{job}/log", WEB_ROLE_VIEW, ASKS(JOB_LOG_GET, JOB_LOG), .query = "after",
     .summary = "A job's events, with larger numbers than `after`."},
    {WEB_GET, "/api/v1/jobs/{job}/trace", WEB_ROLE_VIEW, ASKS(JOB_TRACE_GET, JOB_TRACE), .query = "after",
     .summary = "When what was done for a job, with larger numbers than `after`."},
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/history", WEB_ROLE_VIEW, ASKS(HISTORY_GET, HISTORY),
     .summary = "How a frame's error decreased."},
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/tiles", WEB_ROLE_VIEW, ASKS(FRAME_TILES_GET, FRAME_TILES),
     .query = "shares",
     .summary = "What a frame's tiles have: samples, error, time, and who rendered them; with `shares` each thread's part."},
    PICTURE("exr", "exr", "A finished frame as OpenEXR, linear."),
    PICTURE("png", "png", "A finished frame as PNG."),
    PICTURE("jpg", "jpeg", "A finished frame as JPEG."),
    PICTURE("effects.json", "effects_json", "A finished frame's manifest: effects, causes, times."),
    PICTURE("preview.exr", "preview_exr", "A frame as it is now, as OpenEXR, linear."),
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/preview.png", WEB_ROLE_VIEW, ASKS(OUTPUT_GET, OUTPUT_DATA),
     .run = api_picture, .fixed = "kind=preview_png",
     .query = "tonemap exposure metering metering_percentile white_kelvin no_dither param.*",
     .summary = "A frame as it is now, as PNG, perhaps tone mapped otherwise than the job's pictures."},

    {WEB_GET, "/api/v1/workers", WEB_ROLE_VIEW, ASKS(WORKER_QUERY, WORKER_LIST), .query = "name gone job",
     .summary = "List the workers that are connected, with `gone` also those that left."},
    {WEB_GET, "/api/v1/workers/{name}", WEB_ROLE_VIEW, ASKS(WORKER_QUERY, WORKER_LIST), .fixed = "gone=1",
     .summary = "Describe a worker, with its history and the last lines of its log."},
    WORKER_VERB("drain", "Drain a worker: it finishes what it has and gets no more."),
    WORKER_VERB("resume", "Let a drained worker take work again."),
    WORKER_VERB("block", "Block a name: it gets no work, and what it has goes to others."),
    WORKER_VERB("unblock", "Unblock a name."),

    {WEB_GET, "/api/v1/store", WEB_ROLE_VIEW, ASKS(STORE_QUERY, STORE_INFO), .summary = "What takes the room."},
    {WEB_POST, "/api/v1/store/collect", WEB_ROLE_ADMIN, ASKS(STORE_QUERY, STORE_INFO), .fixed = "collect=1",
     .summary = "Remove what may go, and say what takes the room."},
    {WEB_GET, "/api/v1/tokens", WEB_ROLE_ADMIN, ASKS(TOKEN_QUERY, TOKEN_LIST), .summary = "List the tokens."},
    {WEB_POST, "/api/v1/tokens", WEB_ROLE_ADMIN, ASKS(TOKEN_CREATE, TOKEN_MADE),
     .summary = "Make a token, which only this answer has."},
    {WEB_DELETE, "/api/v1/tokens/{token}", WEB_ROLE_ADMIN, ASKS(TOKEN_REVOKE, TOKEN_LIST),
     .summary = "Revoke a token, and end what was begun with it."},
    {WEB_POST, "/api/v1/tokens/{token}/renew", WEB_ROLE_ADMIN, ASKS(TOKEN_RENEW, TOKEN_MADE),
     .summary = "Give a token another secret, which only this answer has."},
    {WEB_GET, "/api/v1/webhooks", WEB_ROLE_ADMIN, ASKS(WEBHOOK_QUERY, WEBHOOK_LIST), .summary = "List the webhooks."},
    {WEB_POST, "/api/v1/webhooks", WEB_ROLE_ADMIN, ASKS(WEBHOOK_ADD, WEBHOOK_LIST),
     .summary = "Add a webhook; only this answer has the secret that signs what is sent."},
    {WEB_DELETE, "/api/v1/webhooks/{webhook}", WEB_ROLE_ADMIN, ASKS(WEBHOOK_REMOVE, WEBHOOK_LIST),
     .summary = "Remove a webhook, with what it was not sent yet."},
    {WEB_POST, "/api/v1/webhooks/{webhook}/test", WEB_ROLE_ADMIN, ASKS(WEBHOOK_TEST, WEBHOOK_LIST),
     .summary = "Send a webhook an event now, and say whether it was taken."},
    {WEB_POST, "/api/v1/blobs/missing", WEB_ROLE_SUBMIT, ASKS(BLOB_QUERY, BLOB_MISSING),
     .summary = "Which of these blobs are not on the coordinator?"},
    {WEB_PUT, "/api/v1/blobs/{digest}", WEB_ROLE_SUBMIT, .run = api_blob_put, .streams_body = 1,
     .summary = "Send a blob: the body is its bytes, the path names their SHA-256."},
    {WEB_GET, "/readyz", WEB_ROLE_NONE, .run = web_readyz, .summary = "Say whether the coordinator takes work."},
    {WEB_GET, "/metrics", WEB_ROLE_VIEW, .run = web_metrics, .summary = "The farm in numbers, in Prometheus' text format."},

    {WEB_GET, "/api/v1/events", WEB_ROLE_VIEW, .run = events_stream, .query = "after",
     .summary = "A stream of server-sent events: what changes on the farm."},
    {WEB_GET, "/api/v1/live", WEB_ROLE_VIEW, .open = live_open,
     .summary = "A WebSocket: the same events, and a frame's picture while it is rendered."},
    {WEB_POST, "/api/v1/imports", WEB_ROLE_SUBMIT, .run = import_begin,
     .summary = "Begin an upload of a scene's files."},
    {WEB_PUT, "/api/v1/imports/{import}/files/{path...}", WEB_ROLE_SUBMIT, .run = import_file, .streams_body = 1,
     .summary = "Upload a file: its path is that below the scene's folder, its body the bytes."},
    {WEB_POST, "/api/v1/imports/{import}", WEB_ROLE_SUBMIT, .run = import_run,
     .summary = "Submit a scene among the uploaded files, with options as `azulejo submit` has them."},
    {WEB_DELETE, "/api/v1/imports/{import}", WEB_ROLE_SUBMIT, .run = import_remove,
     .summary = "Remove an upload and its files."},
};

static void events_stream(struct web_request *request)
{
    live_stream(request->web->live, request);
}

static void live_open(struct web_socket *socket)
{
    live_socket(socket->web->live, socket);
}

/* Is the job, which the path names first, the caller's own? The answer is given if not. */
static int is_own(struct web_request *request)
{
    const char *text = request->parameters[0];
    const struct job *job = queue_find(&request->web->server->farm.queue, strtoull(text ? text : "", NULL, 10));
    struct error why = {0};

    if (job && job->owner[0] && strcmp(job->owner, request->caller.who) == 0)
        return 1;
    if (job)
        error_set(&why, STATUS_ERR_REFUSED,
                  "job %" PRIu64 " belongs to %s: a token of the role %s may do this to the jobs of %s only", job->id,
                  job->owner[0] ? job->owner : "nobody", web_role_name(request->caller.role), request->caller.who);
    else
        error_set(&why, STATUS_ERR_NOT_FOUND, "there is no job %.20s", text);
    problem_answer(request, problem_of_request(why.code, 1), why.text);
    return 0;
}

/* A job belongs to the token's owner; only operators submit for somebody else. */
static void api_submit(struct web_request *request)
{
    Azulejo__Wire__Envelope envelope;
    struct error err = {0};
    ProtobufCMessage *body;
    const char *owner;

    if (web_call_message(request, &envelope, &body, &err) != STATUS_OK) {
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return;
    }
    owner = envelope.job_submit->owner;
    if (owner[0] && request->caller.role < WEB_ROLE_OPERATE && strcmp(owner, request->caller.who) != 0) {
        error_set(&err, STATUS_ERR_REFUSED, "owner: a token of the role submit submits for %s only",
                  request->caller.who);
        problem_answer(request, problem_of_request(err.code, 1), err.text);
    } else {
        web_call_go(request, &envelope);
    }
    json_wire_free(body);
}

/* Does a list of words name it? "param.*" names all that begin so. */
static int is_named(const char *words, const char *name, size_t length)
{
    while (words && *words) {
        size_t word = strcspn(words, " ");
        if (word == length ? strncmp(words, name, length) == 0
                           : word > 0 && words[word - 1] == '*' && length >= word && strncmp(words, name, word - 1) == 0)
            return 1;
        words += word + (words[word] == ' ');
    }
    return 0;
}

/* Does the route know all values of the query? The answer is given if not. */
static int check_query(struct web_request *request)
{
    const char *known = request->route->query, *value;
    char text[320];

    for (size_t i = 0; (value = web_query_at(request, i)); i++) {
        size_t length = strcspn(value, "=");
        if (is_named(known, value, length))
            continue;
        snprintf(text, sizeof text, "this path's query has no value '%.*s'%s%s", length < 64 ? (int)length : 64, value,
                 known ? "; it knows: " : "", known ? known : "");
        problem_answer(request, PROBLEM_INPUT, text);
        return 0;
    }
    return 1;
}

/* Run the request's handler, or send its message to the farm. */
static void run(struct web_request *request)
{
    const struct web_route *route = request->route;

    if (strncmp(route->path, "/api/", 5) == 0 && !check_query(request))
        return;
    if (route->own_jobs_suffice && request->caller.role < route->role && !is_own(request))
        return;
    if (route->run)
        route->run(request);
    else
        web_call(request);
}

const struct web_routing web_routing = {routes, sizeof routes / sizeof *routes, run};
