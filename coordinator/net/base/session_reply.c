/* What a session sends in one message: answers, failures, notices, and its end. */
#include <inttypes.h>

#include "common/system/log.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session.h"
#include "coordinator/net/session/session_messages.h"
#include "protocol/message.h"

void session_send(struct session *session, const Azulejo__Wire__Envelope *envelope)
{
    if (session->state != SESSION_ENDING && channel_send(session->channel, envelope) != STATUS_OK)
        log_debug("session %u: %s was not sent", session->id, message_name(envelope));
}

void session_fail(struct session *session, uint64_t request, const struct error *why)
{
    if (session->state != SESSION_ENDING && message_send_failure(session->channel, request, why) != STATUS_OK)
        log_debug("session %u: a failure was not sent", session->id);
}

void session_notice(struct session *session, int level, const char *text)
{
    Azulejo__Wire__Notice notice = AZULEJO__WIRE__NOTICE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(NOTICE, notice, &notice);

    notice.level = (uint32_t)level;
    notice.text = (char *)text;
    session_send(session, &envelope);
}

void session_revoke(struct session *session, uint64_t lease, const char *reason)
{
    Azulejo__Wire__LeaseRevoke revoke = AZULEJO__WIRE__LEASE_REVOKE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(LEASE_REVOKE, lease_revoke, &revoke);

    revoke.lease = lease;
    revoke.reason = (char *)reason;
    session_send(session, &envelope);
}

void session_end(struct session *session, const struct error *why)
{
    if (session->state == SESSION_ENDING)
        return;
    if (why)
        session_fail(session, 0, why);
    session->state = SESSION_ENDING;
    channel_close(session->channel);
}

void session_refuse_key(struct session *session, const struct error *why)
{
    Azulejo__Wire__Failure failure = AZULEJO__WIRE__FAILURE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(FAILURE, failure, &failure);

    failure.code = why->code;
    failure.text = (char *)why->text;
    failure.key = 1;
    session_send(session, &envelope);
    session_end(session, NULL);
}

void session_reply(struct session *session, uint64_t request, Azulejo__Wire__Envelope *envelope)
{
    envelope->request = request;
    session_send(session, envelope);
}

void session_accepted(struct session *session, uint64_t request, uint64_t job, uint32_t estimate_spp)
{
    Azulejo__Wire__JobAccepted accepted = AZULEJO__WIRE__JOB_ACCEPTED__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_ACCEPTED, job_accepted, &accepted);

    accepted.job = job;
    accepted.estimate_spp = estimate_spp;
    session_reply(session, request, &envelope);
}

void session_stored(struct session *session, uint64_t request, const struct digest *digest)
{
    Azulejo__Wire__BlobStored stored = AZULEJO__WIRE__BLOB_STORED__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_STORED, blob_stored, &stored);

    wire_digest_set(&stored.digest, digest);
    session_reply(session, request, &envelope);
}

struct job *session_job(struct session *session, uint64_t id, struct error *err)
{
    struct job *job = queue_find(&session->server->farm.queue, id);

    if (!job)
        error_set(err, STATUS_ERR_NOT_FOUND, "there is no job %" PRIu64, id);
    return job;
}
