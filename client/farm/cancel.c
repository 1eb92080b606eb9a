#include "client/farm/cancel.h"

#include "client/farm/job_info.h"

status cancel_job(struct connection *c, uint64_t job, int discard, Azulejo__Wire__Envelope **out,
                  struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobCancel body = AZULEJO__WIRE__JOB_CANCEL__INIT;

    body.job = job;
    body.discard = discard;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_CANCEL;
    envelope.job_cancel = &body;
    return job_ask(c, &envelope, job, out, err);
}
