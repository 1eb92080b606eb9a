/* session_may: may the holder of this key, or of this token, ask for that? By common/schema/requests.h alone. */
#pragma once

#include "common/schema/requests.h"
#include "coordinator/net/session/session.h"

/* ERR_REFUSED, of a token ERR_FORBIDDEN, says which role may. A job that does not exist is not refused here. */
status session_may(const struct session *session, enum request_name request, const Azulejo__Wire__Envelope *message,
                   struct error *err) MUST_CHECK;
/* For a job that is submitted: whose it is to be ("": not said), and its priority. */
status session_may_submit(const struct session *session, const char *owner, int32_t priority,
                          struct error *err) MUST_CHECK;
