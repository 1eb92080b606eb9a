#include "common/system/log_limit.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"

static int is_over(const struct log_limit_subject *s, uint64_t now_ns)
{
    return s->written_ns == 0 || now_ns - s->written_ns >= LOG_LIMIT_PERIOD_MS * NS_PER_MS;
}

/* The subject's own entry, or the oldest one whose period is over, or the shared one. */
static struct log_limit_subject *find(struct log_limit *limit, const char *name, uint64_t now_ns)
{
    struct log_limit_subject *oldest = &limit->subjects[0];

    for (int i = 0; i < LOG_LIMIT_SUBJECTS; i++) {
        struct log_limit_subject *s = &limit->subjects[i];
        if (strcmp(s->name, name) == 0)
            return s;
        if (s->written_ns < oldest->written_ns)
            oldest = s;
    }
    if (!is_over(oldest, now_ns))
        return &limit->rest;
    limit->rest.left_out += oldest->left_out;
    memset(oldest, 0, sizeof *oldest);
    snprintf(oldest->name, sizeof oldest->name, "%s", name);
    return oldest;
}

int log_limit_pass(struct log_limit *limit, const char *subject, uint64_t now_ns, uint64_t *left_out)
{
    char name[LOG_LIMIT_SUBJECT_SIZE];
    struct log_limit_subject *s;

    snprintf(name, sizeof name, "%s", subject);
    s = find(limit, name, now_ns);
    *left_out = s->left_out;
    if (!is_over(s, now_ns)) {
        s->left_out++;
        return 0;
    }
    s->left_out = 0;
    s->written_ns = now_ns;
    return 1;
}
