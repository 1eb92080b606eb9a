/* held: answers that wait until what they say is on disk. The store's thread writes it; the loop goes on meanwhile.
 *
 *   session_hold --the store wrote all that was noted before, or failed to--> the answer is made and sent
 *
 * A store that cannot be written sends them as well: the farm then says that it cannot, and that the job's state is not
 * stored yet; answers that say nothing of that become failures. A session that ended in between gets none.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store.h"

enum { SERVER_HELD_MAX = 4096 }; /* answers that wait at once */

struct server;
struct session;

/* What the answer is about. */
struct held_subject {
    uint64_t number, version;    /* a job or a token; what the page knows then */
    char text[JOB_NAME_MAX + 1]; /* a worker, a job's name, or a secret, which is wiped */
    int state;                   /* of a job that is gone */
    int is_plain;                /* the answer says nothing of the store: where that fails, a failure is sent instead */
};
typedef status held_answer(struct session *session, uint64_t request, const struct held_subject *subject,
                           uint64_t now_ns, struct error *err);

/* Make the answer when all that was noted before is on disk. ERR_NO_MEMORY: it is not made. */
status session_hold(struct session *session, uint64_t request, held_answer *answer, const struct held_subject *subject,
                    struct error *err) MUST_CHECK;
/* ERR_LIMIT: too many answers wait already. */
status held_has_room(const struct server *server, struct error *err) MUST_CHECK;
