#include "coordinator/job/suspicion.h"

#include <string.h>

/* FNV-1a, 64 bits. */
static uint64_t hash_bytes(uint64_t hash, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        hash = (hash ^ (unsigned char)bytes[i]) * 0x100000001b3u;
    return hash;
}

uint64_t machine_identity(const char *host, const char *address)
{
    const char *port = strrchr(address, ':');
    uint64_t hash = hash_bytes(0xcbf29ce484222325u, host, strlen(host) + 1);

    hash = hash_bytes(hash, address, port ? (size_t)(port - address) : strlen(address));
    return hash ? hash : 1;
}

int suspicion_add(struct suspicion *suspicion, uint64_t machine, uint64_t lent_ns, uint64_t now_ns)
{
    if (suspicion->deaths > 0 && lent_ns < suspicion->death_ns)
        return 0;
    if (suspicion->deaths++ == 0)
        suspicion->machine = machine;
    suspicion->several |= machine != suspicion->machine;
    suspicion->death_ns = now_ns;
    return 1;
}

void suspicion_lent(struct suspicion *suspicion, uint32_t session)
{
    if (suspicion->deaths > 0)
        suspicion->probe = session;
}

void suspicion_clear(struct suspicion *suspicion) { memset(suspicion, 0, sizeof *suspicion); }

int suspicion_is_enough(const struct suspicion *suspicion)
{
    return suspicion->deaths >= (suspicion->several ? SUSPICION_DEATHS : SUSPICION_DEATHS_ALONE);
}
