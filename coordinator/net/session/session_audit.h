/* session_audit: what clients asked for, in the audit log (coordinator/store/files/audit.h). */
#pragma once

#include "coordinator/net/session/session.h"
#include "coordinator/store/files/audit.h"

void session_actor(const struct session *session, struct audit_actor *out);
/* The words that a person types for what the message asks: "pause", "key revoke". */
const char *session_verb(const Azulejo__Wire__Envelope *message);
/* Note a message that changes something and was answered with `s`, unless session_audit_submission does so
 * later. What only asks or sends bytes is not noted. */
void session_audit(struct session *session, const Azulejo__Wire__Envelope *message, status s, const struct error *err);
/* Note a submission that was taken (job `number`) or not. */
void session_audit_submission(struct server *server, const struct audit_actor *actor, const char *name, uint64_t number,
                              int again, status s, const struct error *err);
