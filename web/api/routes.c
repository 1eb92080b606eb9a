#include "web/api/routes.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/schema/requests.h"
#include "protocol/message.h"
#include "web/api/api_blobs.h"
#include "web/api/api_files.h"
#include "web/api/api_tables.h"
#include "web/api/assets.h"
#include "web/api/call.h"
#include "web/api/figures.h"
#include "web/api/health.h"
#include "web/uploads/import.h"
#include "protocol/json/json_wire.h"
#include "web/api/live.h"
#include "web/base/problem.h"
#include "web/api/sign_in.h"
#include "web/web.h"

#define BODY(name) AZULEJO__WIRE__ENVELOPE__BODY_##name
/* The role that common/schema/requests.h says. */
#define MAY(request) .role = (enum web_role)REQUEST_ROLE_##request, .own_jobs_suffice = REQUEST_OWN_##request
/* A message to the farm, and what it answers with. */
#define ASKS(question, reply) MAY(question), .message = BODY(question), .answer = BODY(reply)
/* What is done to a job (common/schema/verbs.h): its owner may. */
#define VERB(NAME, name, ROLE, run, says, ...)                                                                  \
    {WEB_POST, "/api/v1/jobs/{job}/" #name, ASKS(JOB_##NAME, JOB_LIST), .summary = says},
#define VARIANT(...)
#define WORKER_VERB(word, says)                                                                                 \
    {WEB_POST, "/api/v1/workers/{name}/" word, ASKS(WORKER_STEER, WORKER_LIST),             \
     .fixed = "verb=" word, .summary = says}

static web_handler events_stream, tiles_stream;
static void live_open(struct web_socket *socket);

#define PICTURE(file, what, says)                                                                               \
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/" file, ASKS(OUTPUT_GET, OUTPUT_DATA),        \
     .run = api_picture, .fixed = "kind=" what, .summary = says}

static const struct web_route routes[] = {
    {WEB_GET, "/", WEB_ROLE_NONE, .run = web_asset_index, .summary = "The page."},
    {WEB_GET, "/assets/{file}", WEB_ROLE_NONE, .run = web_asset, .summary = "A file of the page."},
    {WEB_GET, "/assets/{folder}/{file}", WEB_ROLE_NONE, .run = web_asset_in_folder, .summary = "A file of a folder of the page."},
    {WEB_GET, "/docs/errors", WEB_ROLE_NONE, .run = problem_list, .summary = "The codes of problems, as text."},
    {WEB_POST, "/api/v1/session", WEB_ROLE_NONE, .run = web_session_post, .summary = "Sign in with a token, for a cookie."},
    {WEB_GET, "/api/v1/session", WEB_ROLE_VIEW, .run = web_session_get, .summary = "Tell who asks."},
    {WEB_DELETE, "/api/v1/session", WEB_ROLE_NONE, .run = web_session_delete, .summary = "Sign out: forget the cookie."},
    {WEB_GET, "/healthz", WEB_ROLE_NONE, .run = web_healthz, .summary = "Say that the coordinator is alive."},

    {WEB_GET, "/api/v1/openapi.yaml", WEB_ROLE_VIEW, .run = web_asset_openapi,
     .summary = "This description of the API."},
    {WEB_GET, "/api/v1/farm", ASKS(FARM_QUERY, FARM_INFO), .summary = "Describe the farm: its jobs' states, workers, store."},
    {WEB_GET, "/api/v1/operators", WEB_ROLE_VIEW, .run = api_operators,
     .summary = "List the tone mappers with their parameters."},
    {WEB_GET, "/api/v1/effects", WEB_ROLE_VIEW, .run = api_effects,
     .summary = "The names behind bits and numbers: effects, layers, choices."},

    {WEB_GET, "/api/v1/verbs", WEB_ROLE_VIEW, .run = api_verbs,
     .summary = "What can be done to jobs: paths, roles, arguments, states, and words for people."},

    {WEB_GET, "/api/v1/log", ASKS(JOB_LOG_GET, JOB_LOG), .query = "after newest",
     .summary = "Tell what happened to all jobs: after a number, or the newest events."},
    {WEB_GET, "/api/v1/jobs", ASKS(JOB_QUERY, JOB_LIST), .query = "filter before first",
     .summary = "List jobs: the newest that match the filter, or with `first` those that are served next."},
    {WEB_POST, "/api/v1/jobs", ASKS(JOB_SUBMIT, JOB_ACCEPTED),
     .summary = "Submit a job whose scene and blobs were sent."},
    {WEB_GET, "/api/v1/jobs/{job}", ASKS(JOB_QUERY, JOB_LIST), .summary = "Describe a job."},
    {WEB_DELETE, "/api/v1/jobs/{job}", ASKS(JOB_REMOVE, JOB_LIST),
     .query = "unless_read", .summary = "Remove a job that has ended, with its films and pictures."},
    JOB_VERBS(VERB, VARIANT)
    {WEB_GET, "/api/v1/jobs/{job}/log", ASKS(JOB_LOG_GET, JOB_LOG), .query = "after",
     .summary = "A job's events, with larger numbers than `after`."},
    {WEB_GET, "/api/v1/jobs/{job}/trace", ASKS(JOB_TRACE_GET, JOB_TRACE), .query = "after",
     .summary = "When what was done for a job, with larger numbers than `after`."},
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/history", ASKS(HISTORY_GET, HISTORY),
     .summary = "How a frame's error decreased."},
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/tiles", ASKS(FRAME_TILES_GET, FRAME_TILES),
     .query = "shares",
     .summary = "What a frame's tiles have: samples, error, time, and who rendered them; with `shares` each thread's part."},
    PICTURE("exr", "exr", "A finished frame as OpenEXR, linear."),
    PICTURE("png", "png", "A finished frame as PNG."),
    PICTURE("jpg", "jpeg", "A finished frame as JPEG."),
    PICTURE("effects.json", "effects_json", "A finished frame's manifest: effects, causes, times."),
    PICTURE("preview.exr", "preview_exr", "A frame as it is now, as OpenEXR, linear."),
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/preview.png", ASKS(OUTPUT_GET, OUTPUT_DATA),
     .run = api_picture, .fixed = "kind=preview_png",
     .query = "tonemap exposure metering metering_percentile white_kelvin denoise no_dither param.*",
     .summary = "A frame as it is now, as PNG, perhaps tone mapped otherwise than the job's pictures."},

    {WEB_GET, "/api/v1/workers", ASKS(WORKER_QUERY, WORKER_LIST), .query = "name gone job",
     .summary = "List the workers that are connected, with `gone` also those that left."},
    {WEB_GET, "/api/v1/workers/{name}", ASKS(WORKER_QUERY, WORKER_LIST), .fixed = "gone=1",
     .summary = "Describe a worker, with its history and the last lines of its log."},
    WORKER_VERB("drain", "Drain a worker: it finishes what it has and gets no more."),
    WORKER_VERB("resume", "Let a drained worker take work again."),
    WORKER_VERB("block", "Block a name: it gets no work, and what it has goes to others."),
    WORKER_VERB("unblock", "Unblock a name."),
    {WEB_POST, "/api/v1/workers/{name}/distrust", ASKS(WORKER_DISTRUST, DISTRUST_REPORT),
     .summary = "Block a name, and render again what it delivered; lists the frames that cannot be."},

    {WEB_GET, "/api/v1/store", ASKS(STORE_QUERY, STORE_INFO), .summary = "What takes the room."},
    {WEB_POST, "/api/v1/store/collect", MAY(STORE_COLLECT), .message = BODY(STORE_QUERY),
     .answer = BODY(STORE_INFO), .fixed = "collect=1",
     .summary = "Remove what may go, and say what takes the room."},
    {WEB_GET, "/api/v1/tokens", ASKS(TOKEN_QUERY, TOKEN_LIST), .summary = "List the tokens."},
    {WEB_POST, "/api/v1/tokens", ASKS(TOKEN_CREATE, TOKEN_MADE),
     .summary = "Make a token, which only this answer has."},
    {WEB_DELETE, "/api/v1/tokens/{token}", ASKS(TOKEN_REVOKE, TOKEN_LIST),
     .summary = "Revoke a token, and end what was begun with it."},
    {WEB_POST, "/api/v1/tokens/{token}/renew", ASKS(TOKEN_RENEW, TOKEN_MADE),
     .summary = "Give a token another secret, which only this answer has."},
    {WEB_GET, "/api/v1/keys", ASKS(KEY_QUERY, KEY_LIST), .summary = "List the names whose keys were used or changed."},
    {WEB_POST, "/api/v1/keys/{name}/revoke", ASKS(KEY_CHANGE, KEY_LIST),
     .summary = "Revoke all keys of a name, and end their connections."},
    {WEB_POST, "/api/v1/keys/{name}/rotate", ASKS(KEY_CHANGE, KEY_LIST), .fixed = "rotate=1",
     .summary = "Begin the next generation of a name's keys; the present one stays good for `keep_s`."},
    {WEB_POST, "/api/v1/blobs/missing", ASKS(BLOB_QUERY, BLOB_MISSING),
     .summary = "Which of these blobs are not on the coordinator?"},
    {WEB_PUT, "/api/v1/blobs/{digest}", MAY(BLOB_PUT), .run = api_blob_put, .streams_body = 1,
     .summary = "Send a blob: the body is its bytes, the path names their SHA-256."},
    {WEB_GET, "/readyz", WEB_ROLE_NONE, .run = web_readyz, .summary = "Say whether the coordinator takes work."},
    {WEB_GET, "/metrics", MAY(METRICS_GET), .run = web_metrics, .summary = "The farm in numbers, in Prometheus' text format."},

    {WEB_GET, "/api/v1/events", MAY(JOB_WATCH), .run = events_stream, .query = "after",
     .summary = "A stream of server-sent events: what changes on the farm."},
    {WEB_GET, "/api/v1/live", MAY(JOB_WATCH), .open = live_open,
     .summary = "A WebSocket: the same events, and a frame's picture while it is rendered."},
    {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/live", MAY(JOB_WATCH), .message = BODY(TILES_WATCH), .run = tiles_stream,
     .query = "layer", .summary = "A frame's picture while it is rendered, as one answer that goes on."},
    {WEB_POST, "/api/v1/imports", MAY(JOB_SUBMIT), .run = import_begin,
     .summary = "Begin an upload of a scene's files."},
    {WEB_PUT, "/api/v1/imports/{import}/files/{path...}", MAY(JOB_SUBMIT), .run = import_file, .streams_body = 1,
     .summary = "Upload a file: its path is that below the scene's folder, its body the bytes."},
    {WEB_POST, "/api/v1/imports/{import}", MAY(JOB_SUBMIT), .run = import_run,
     .summary = "Submit a scene among the uploaded files, with options as `azulejo submit` has them."},
    {WEB_DELETE, "/api/v1/imports/{import}", MAY(JOB_SUBMIT), .run = import_remove,
     .summary = "Remove an upload and its files."},
};

static void events_stream(struct web_request *request) { live_stream(request->web->live, request); }

static void tiles_stream(struct web_request *request) { live_tiles(request->web->live, request); }

static void live_open(struct web_socket *socket) { live_socket(socket->web->live, socket); }

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
    if (route->run)
        route->run(request);
    else
        web_call(request);
}

const struct web_routing web_routing = {routes, sizeof routes / sizeof *routes, run};
