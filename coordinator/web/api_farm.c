#include "coordinator/web/api_farm.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/base/clock.h"
#include "coordinator/net/server.h"
#include "coordinator/net/workers_list.h"
#include "coordinator/web/json_wire.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/web.h"

/* Where the farm's programs connect to: "127.0.0.1:7420". */
static void farm_address(const struct server *server, char *out, size_t size)
{
    struct sockaddr_storage address;
    int length = sizeof address;
    char host[64] = "";

    out[0] = 0;
    if (uv_is_closing((const uv_handle_t *)&server->listener) ||
        uv_tcp_getsockname(&server->listener, (struct sockaddr *)&address, &length) != 0)
        return;
    if (address.ss_family == AF_INET6) {
        const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)&address;
        uv_ip6_name(six, host, sizeof host);
        snprintf(out, size, "[%s]:%u", host, ntohs(six->sin6_port));
    } else {
        const struct sockaddr_in *four = (const struct sockaddr_in *)&address;
        uv_ip4_name(four, host, sizeof host);
        snprintf(out, size, "%s:%u", host, ntohs(four->sin_port));
    }
}

static void put_states(struct buffer *out, const struct queue *queue)
{
    uint64_t count[JOB_STATE_COUNT] = {0};

    for (size_t i = 0; i < queue->count; i++)
        count[queue->all[i]->state]++;
    buffer_puts(out, ",\"states\":{");
    for (int i = 0; i < JOB_STATE_COUNT; i++) {
        char word[64];
        json_wire_word(&azulejo__wire__job_state__descriptor, i, word);
        buffer_printf(out, "%s\"%s\":%" PRIu64, i ? "," : "", word, count[i]);
    }
    buffer_puts(out, "}");
}

static void put_workers(struct buffer *out, const struct farm *farm, uint64_t now_ns)
{
    uint32_t workers = 0, working = 0;
    uint64_t threads = 0;
    double rate = 0;

    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (worker->is_replaced)
            continue;
        workers++;
        working += worker->held.units > 0;
        threads += worker->threads;
        rate += rate_per_second(&worker->rate, now_ns);
    }
    buffer_printf(out, ",\"workers\":%" PRIu32 ",\"workers_working\":%" PRIu32 ",\"threads\":%" PRIu64
                  ",\"samples_per_second\":", workers, working, threads);
    json_put_number(out, rate);
}

status api_farm_json(struct server *server, struct buffer *out, struct error *err)
{
    struct error why = {0};
    char address[96];

    farm_address(server, address, sizeof address);
    buffer_puts(out, "{\"software\":\"azulejo " AZULEJO_VERSION "\",\"address\":");
    json_put_text(out, address);
    buffer_printf(out, ",\"protocol_version\":%d,\"begun_at\":%" PRId64 ",\"now\":%" PRId64, PROTOCOL_VERSION,
                  server->farm.begun_s, server->farm.wall_s);
    buffer_printf(out, ",\"ending\":%s", server->state == SERVER_LISTENING ? "false" : "true");
    put_states(out, &server->farm.queue);
    put_workers(out, &server->farm, clock_monotonic_ns());
    buffer_printf(out, ",\"conflicts\":%" PRIu64 ",\"store_usable\":%s,\"store_why\":", server->farm.conflicts,
                  farm_store_usable(&server->farm, &why) == STATUS_OK ? "true" : "false");
    json_put_text(out, why.text);
    buffer_puts(out, "}");
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "what the farm is");
}

static void put_list(void *user, Azulejo__Wire__WorkerList *list)
{
    json_wire_put(user, &list->base);
}

status api_workers_json(struct server *server, struct buffer *out, struct error *err)
{
    status s = workers_list(server, "", 0, 0, put_list, out, clock_monotonic_ns(), err);

    return s != STATUS_OK || buffer_ok(out) ? s : error_no_memory(err, "a list of workers");
}

void api_farm(struct web_request *request)
{
    struct buffer text = BUFFER_INIT;
    struct error err = {0};

    if (api_farm_json(request->web->server, &text, &err) == STATUS_OK)
        web_answer(request, 200, "application/json", NULL, text.data, text.size);
    else
        problem_answer(request, problem_of_farm(err.code), err.text);
    buffer_release(&text);
}
