#include "client/cancel.h"

#include <inttypes.h>

#include "client/job_info.h"
#include "protocol/message.h"

status cancel_job(struct connection *c, uint64_t job, int discard, Azulejo__Wire__Envelope **out,
                  struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobCancel body = AZULEJO__WIRE__JOB_CANCEL__INIT;
    status result;

    body.job = job;
    body.discard = discard;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_CANCEL;
    envelope.job_cancel = &body;
    result = connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST, out, err);
    if (result == STATUS_OK && !job_list_find((*out)->job_list, job)) {
        message_free(*out);
        *out = NULL;
        result = error_set(err, STATUS_ERR_NOT_FOUND, "there is no job %" PRIu64, job);
    }
    return result;
}
