#include "coordinator/frame/audits.h"

#include "protocol/worker_name.h"

uint64_t audit_mix(uint64_t x)
{
    x ^= x >> 33;
    x *= UINT64_C(0xff51afd7ed558ccd);
    x ^= x >> 33;
    x *= UINT64_C(0xc4ceb9fe1a85ec53);
    return x ^ x >> 33;
}

int audit_is_chosen(uint64_t secret, uint64_t units_before, int is_doubted, uint64_t job, uint32_t frame,
                    struct unit_name unit)
{
    uint64_t x = audit_mix(secret ^ audit_mix(job ^ audit_mix((uint64_t)frame << 32 ^ unit.tile)));

    return units_before < AUDIT_FIRST ||
           audit_mix(x ^ ((uint64_t)unit.group << 32 | unit.pass)) % (is_doubted ? AUDIT_SHARE_DOUBT : AUDIT_SHARE) == 0;
}

int audit_votes_agree(const struct audit_vote *a, const struct audit_vote *b)
{
    return a->has_digest && b->has_digest ? digest_equal(&a->digest, &b->digest) : a->hash == b->hash;
}

int audit_votes_share_key(const struct audit_vote *votes, uint32_t count)
{
    for (uint32_t i = 1; i < count; i++)
        if (!worker_labels_share_key(votes[i].label, votes[0].label))
            return 0;
    return 1;
}

/* The voices for an answer. */
static uint32_t agreeing(const struct audit_vote *votes, uint32_t count, const struct audit_vote *with)
{
    int by_name = audit_votes_share_key(votes, count);
    uint32_t same = 0;

    for (uint32_t i = 0; i < count; i++) {
        uint32_t k = by_name ? i : 0;
        while (k < i && !(worker_labels_share_key(votes[k].label, votes[i].label) && audit_votes_agree(&votes[k], with)))
            k++;
        same += k == i && audit_votes_agree(&votes[i], with);
    }
    return same;
}

enum audit_verdict audit_judge(const struct audit_vote *votes, uint32_t count, uint32_t others, uint32_t *right)
{
    uint32_t most = 0, second = 0, left = AUDIT_VOTES_MAX - count < others ? AUDIT_VOTES_MAX - count : others;

    for (uint32_t i = 0; i < count; i++) {
        uint32_t same = agreeing(votes, count, &votes[i]);
        if (same > most) {
            most = same;
            *right = i;
        }
    }
    for (uint32_t i = 0; i < count; i++)
        if (!audit_votes_agree(&votes[i], &votes[*right]) && agreeing(votes, count, &votes[i]) > second)
            second = agreeing(votes, count, &votes[i]);
    if (count >= 2 && second == 0)
        return AUDIT_AGREES;
    if (most >= 2 && most > second + left)
        return AUDIT_DECIDED;
    return count >= AUDIT_VOTES_MAX ? AUDIT_OPEN : AUDIT_MORE;
}
