/* audits: which results are rendered again on another worker, and what the answers say. The logic alone: unit_audits.h asks.
 *
 *   a result --audit_is_chosen--> one vote --another worker: the same--> AGREES
 *                                    |--another answer--> MORE votes, until one answer cannot be overtaken: DECIDED
 *                                    |--AUDIT_VOTES_MAX votes and no such answer--> OPEN
 *
 * Two workers that agree on a lie outvote one that does not, so the first two that agree against a third do not decide while
 * other workers could be asked. And a key has one voice, however many workers it has: votes of workers that share one
 * (protocol/worker_name.h) count once for each answer, unless all votes are of that key. */
#pragma once

#include "common/base/digest.h"
#include "coordinator/frame/frame.h"
#include "coordinator/store/store.h"

enum {
    AUDIT_FIRST = 20,        /* units of a worker's connection */
    AUDIT_SHARE = 100,       /* one of so many */
    AUDIT_SHARE_DOUBT = 10,  /* of a worker whose results differed, without a decision */
    AUDIT_VOTES_MAX = 5,
};

struct audit_vote {
    char label[WORKER_LABEL_MAX + 1];
    uint64_t hash;        /* unit_hash() */
    struct digest digest; /* of a result that came with all of its bytes */
    int has_digest;
};

/* 64 bits in which each bit depends on each of x. */
uint64_t audit_mix(uint64_t x);
/* Is this result rendered again? `secret`: a number that no worker knows; `units_before`: by its worker's connection. */
int audit_is_chosen(uint64_t secret, uint64_t units_before, int is_doubted, uint64_t job, uint32_t frame,
                    struct unit_name unit);

enum audit_verdict {
    AUDIT_AGREES,
    AUDIT_MORE,
    AUDIT_DECIDED, /* *right is one of the right votes */
    AUDIT_OPEN,
};
/* `others`: voices that could still be asked. */
enum audit_verdict audit_judge(const struct audit_vote *votes, uint32_t count, uint32_t others, uint32_t *right);
int audit_votes_agree(const struct audit_vote *a, const struct audit_vote *b);
/* Are all of workers of one key? */
int audit_votes_share_key(const struct audit_vote *votes, uint32_t count);
