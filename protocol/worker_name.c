#include "protocol/worker_name.h"

#include <string.h>

int worker_name_is_valid(const char *name)
{
    static const char allowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
    size_t length = strlen(name);

    /* Not an option, for who types it. */
    return length > 0 && length <= WORKER_NAME_BYTES_MAX && name[0] != '-' && strspn(name, allowed) == length;
}
