#include "coordinator/job/trouble.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"

int trouble_is(const struct trouble *trouble) { return trouble->text[0] != 0; }

int trouble_waits(const struct trouble *trouble, uint64_t now_ns)
{
    return trouble_is(trouble) && now_ns < trouble->next_ns;
}

int trouble_note(struct trouble *trouble, const char *text, uint64_t now_ns)
{
    return trouble_note_within(trouble, text, TROUBLE_LAST_MS, now_ns);
}

int trouble_note_within(struct trouble *trouble, const char *text, uint64_t last_ms, uint64_t now_ns)
{
    uint64_t wait_ms = TROUBLE_FIRST_MS;
    int begins = !trouble_is(trouble);

    if (begins) {
        trouble->since_ns = now_ns;
        trouble->tries = 0;
    }
    for (uint32_t i = 0; i < trouble->tries && wait_ms < last_ms; i++)
        wait_ms *= 2;
    if (wait_ms > last_ms)
        wait_ms = last_ms;
    trouble->tries++;
    trouble->next_ns = now_ns + wait_ms * NS_PER_MS;
    snprintf(trouble->text, sizeof trouble->text, "%s", text);
    return begins;
}

int trouble_end(struct trouble *trouble, uint64_t now_ns, uint64_t *lasted_ns)
{
    int was = trouble_is(trouble);

    *lasted_ns = was && now_ns > trouble->since_ns ? now_ns - trouble->since_ns : 0;
    memset(trouble, 0, sizeof *trouble);
    return was;
}
