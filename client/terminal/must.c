#include "client/terminal/must.h"

#include <jansson.h>
#include <unistd.h>

#include "common/base/status.h"

void must_(int done)
{
    static const char line[] = "azulejo: out of memory\n";

    if (done)
        return;
    (void)!write(STDERR_FILENO, line, sizeof line - 1);
    _exit(status_exit_code(STATUS_ERR_NO_MEMORY));
}

void *must(void *block)
{
    must_(block != NULL);
    return block;
}

void must_hold(const struct buffer *buffer) { must_(buffer_ok(buffer)); }

static void *json_memory(size_t size_bytes) { return must(mem_alloc(size_bytes)); }

void must_begin(void) { json_set_alloc_funcs(json_memory, mem_free); }
