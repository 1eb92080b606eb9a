#include "coordinator/net/base/held.h"

#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"

struct held {
    struct server *server;
    uint32_t session;
    uint64_t request;
    held_answer *answer;
    struct held_subject subject;
};

static void on_saved(void *user, status s, const struct error *err)
{
    struct held *held = user;
    struct server *server = held->server;
    struct session *session = session_find(server, held->session);
    uint64_t now_ns = clock_monotonic_ns();
    struct error why = {0};

    server->held--;
    if (session)
        session->held--;
    if (s != STATUS_OK)
        farm_store_failed(&server->farm, err, now_ns);
    if (s != STATUS_OK && held->subject.is_plain) {
        error_set(&why, err->code, "it is done, but not on disk yet, and a crash would undo it: %s", err->text);
        if (session && session->state == SESSION_OPEN)
            session_fail(session, held->request, &why);
    } else if (session && session->state == SESSION_OPEN &&
               held->answer(session, held->request, &held->subject, now_ns, &why) != STATUS_OK)
        session_fail(session, held->request, &why);
    explicit_bzero(held, sizeof *held);
    mem_free(held);
}

status session_hold(struct session *session, uint64_t request, held_answer *answer, const struct held_subject *subject,
                    struct error *err)
{
    struct server *server = session->server;
    struct held *held = mem_alloc(sizeof *held);
    status s;

    NEED(held, err, "an answer that waits for the disk");
    *held = (struct held){server, session->id, request, answer, *subject};
    s = store_when_saved(server->store, on_saved, held, err);
    if (s == STATUS_OK) {
        server->held++;
        session->held++;
    } else {
        mem_free(held);
    }
    return s;
}

status held_has_room(const struct server *server, struct error *err)
{
    if (server->held < SERVER_HELD_MAX)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "%d changes wait for the coordinator's disk already: try again when it has written them",
                     SERVER_HELD_MAX);
}
