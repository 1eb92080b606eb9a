#include "coordinator/net/session/session_may.h"

#include <inttypes.h>
#include <string.h>

#include "coordinator/net/server.h"
#include "coordinator/net/session/session_audit.h"
#include "protocol/fields.h"
#include "protocol/message.h"

static const char *means(const struct session *session) { return session->token ? "token" : "key"; }

/* Of a token the API says that it does not allow it, not that the job's state does not. */
static status refusal(const struct session *session)
{
    return session->token ? STATUS_ERR_FORBIDDEN : STATUS_ERR_REFUSED;
}

static status refuse(const struct session *session, const char *what, enum web_role least, struct error *err)
{
    return error_set(err, refusal(session), "%s needs a %s of the role %s; yours has the role %s", what, means(session),
                     web_role_name(least), web_role_name(session->may));
}

/* Is the job its own? */
static status check_own(const struct session *session, uint64_t number, struct error *err)
{
    const struct job *job = queue_find(&session->server->farm.queue, number);

    if (!job || (job->owner[0] && strcmp(job->owner, session->who) == 0))
        return STATUS_OK;
    return error_set(err, refusal(session),
                     "job %" PRIu64 " belongs to %s: a %s of the role %s may do this to the jobs of %s only", number,
                     job->owner[0] ? job->owner : "an unknown owner", means(session), web_role_name(session->may),
                     session->who);
}

static status check_priority(const struct session *session, int32_t priority, struct error *err)
{
    if (priority <= SUBMIT_PRIORITY_MAX || session->may >= (int)REQUEST_ROLE_JOB_URGENT)
        return STATUS_OK;
    return error_set(err, refusal(session),
                     "priority %d: a %s of the role %s gives at most %d, one of the role %s more", (int)priority,
                     means(session), web_role_name(session->may), SUBMIT_PRIORITY_MAX,
                     web_role_name((enum web_role)REQUEST_ROLE_JOB_URGENT));
}

status session_may(const struct session *session, enum request_name request, const Azulejo__Wire__Envelope *message,
                   struct error *err)
{
    const struct request_rule *rule = &request_rules[request];

    if (request == REQUEST_STORE_QUERY && message->store_query->collect)
        rule = &request_rules[REQUEST_STORE_COLLECT];
    if (session->worker || rule->role == WEB_ROLE_NONE)
        return STATUS_OK; /* which side it is on was looked at */
    if (session->may < rule->role && !(rule->own && session->may >= WEB_ROLE_SUBMIT))
        return refuse(session, session_verb(message), rule->role, err);
    if (session->may < rule->role)
        TRY(check_own(session, message_job(message_body(message)), err));
    return request == REQUEST_JOB_PRIORITY ? check_priority(session, message->job_priority->priority, err) : STATUS_OK;
}

status session_may_submit(const struct session *session, const char *owner, int32_t priority, struct error *err)
{
    if (owner[0] && strcmp(owner, session->who) != 0 && session->may < (int)REQUEST_ROLE_JOB_SUBMIT_FOR)
        return error_set(err, refusal(session), "owner: a %s of the role %s submits for %s only", means(session),
                         web_role_name(session->may), session->who);
    return check_priority(session, priority, err);
}
