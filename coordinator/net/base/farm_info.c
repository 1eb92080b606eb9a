#include "coordinator/net/base/farm_info.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/net/server.h"
#include "protocol/message.h"

static void count_states(struct farm_info *out, const struct queue *queue)
{
    for (int i = 0; i < JOB_STATE_COUNT; i++) {
        azulejo__wire__farm_info__states_entry__init(&out->states[i]);
        out->states[i].key = (char *)job_state_word(i);
        out->state_pointers[i] = &out->states[i];
    }
    for (size_t i = 0; i < queue->count; i++)
        out->states[queue->all[i]->state].value++;
    out->message.n_states = JOB_STATE_COUNT;
    out->message.states = out->state_pointers;
}

static void count_workers(Azulejo__Wire__FarmInfo *out, const struct farm *farm, uint64_t now_ns)
{
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (worker->is_replaced)
            continue;
        out->workers++;
        out->workers_working += worker->held.units > 0;
        out->threads += worker->threads;
        out->samples_per_second += rate_per_second(&worker->rate, now_ns);
    }
}

void farm_info_make(struct farm_info *out, struct server *server, uint64_t now_ns)
{
    Azulejo__Wire__FarmInfo *message = &out->message;

    memset(out, 0, sizeof *out);
    azulejo__wire__farm_info__init(message);
    snprintf(out->address, sizeof out->address, "%s", server->state == SERVER_LISTENING ? server->sockets.names[0] : "");
    message->software = (char *)"azulejo " AZULEJO_VERSION;
    message->address = out->address;
    message->protocol_version = PROTOCOL_VERSION;
    message->begun_at = server->farm.begun_s;
    message->now = server->farm.wall_s;
    message->ending = server->state != SERVER_LISTENING;
    count_states(out, &server->farm.queue);
    count_workers(message, &server->farm, now_ns);
    message->conflicts = server->farm.conflicts;
    message->store_usable = farm_store_usable(&server->farm, &out->why) == STATUS_OK;
    message->store_why = out->why.text;
}

status session_farm(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err UNUSED)
{
    struct farm_info info;
    Azulejo__Wire__Envelope envelope = MESSAGE(FARM_INFO, farm_info, &info.message);

    farm_info_make(&info, session->server, now_ns);
    session_reply(session, message->request, &envelope);
    return STATUS_OK;
}
