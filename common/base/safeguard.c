#include "common/base/safeguard.h"

#ifdef AZULEJO_SAFEGUARDS
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const safeguard_names[SAFEGUARD_COUNT] = {
#define SAFEGUARD_NAME(name, prevents) #name,
    SAFEGUARD_MAP(SAFEGUARD_NAME)
#undef SAFEGUARD_NAME
};
int safeguard_off = -1;

/* Before main, so that every program of this build obeys and no thread sees a change. */
__attribute__((constructor)) static void safeguard_read(void)
{
    const char *off = getenv("AZULEJO_SAFEGUARD_OFF");

    if (!off || !*off)
        return;
    for (int i = 0; i < SAFEGUARD_COUNT; i++) {
        char number[12];
        snprintf(number, sizeof number, "%d", i);
        if (strcmp(off, safeguard_names[i]) == 0 || strcmp(off, number) == 0)
            safeguard_off = i;
    }
    if (safeguard_off < 0) {
        fprintf(stderr, "AZULEJO_SAFEGUARD_OFF=%s: no such safeguard: see common/base/safeguard.h\n", off);
        exit(2);
    }
}
#endif
