/* A job's submission on any bytes, as a client sends it and as a row of the queue keeps it: what is taken keeps all that it
 * says through the store. */
#include <stdint.h>
#include <stdlib.h>

#include "coordinator/job/wire.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void keep(const struct job *job)
{
    struct buffer row = BUFFER_INIT;
    struct job *again;
    struct error err = {0};
    int same = 0;

    if (wire_job_pack(job, &row, &err) != STATUS_OK)
        abort();
    if (wire_job_unpack(&again, row.data, row.size, &err) != STATUS_OK ||
        wire_job_same(job, again, &same, &err) != STATUS_OK || !same)
        abort();
    job_free(again);
    buffer_release(&row);
}

static void tonemap(const uint8_t *data, size_t size)
{
    static struct tonemap_settings settings;
    struct buffer row = BUFFER_INIT;
    struct error err = {0};

    if (wire_tonemap_unpack(&settings, data, size, &err) == STATUS_OK &&
        (wire_tonemap_pack(&settings, &row, &err) != STATUS_OK ||
         wire_tonemap_unpack(&settings, row.data, row.size, &err) != STATUS_OK))
        abort();
    buffer_release(&row);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    Azulejo__Wire__JobSubmit *submit = azulejo__wire__job_submit__unpack(NULL, size, data);
    struct job *job = NULL;
    struct error err = {0};

    tonemap(data, size);
    if (submit && wire_job_get(&job, submit, UINT32_MAX, &err) == STATUS_OK) {
        keep(job);
        job_free(job);
    } else if (submit && !err.text[0]) {
        abort(); /* every refusal says why */
    }
    if (submit)
        azulejo__wire__job_submit__free_unpacked(submit, NULL);
    if (wire_job_unpack(&job, data, size, NULL) == STATUS_OK)
        job_free(job);
    return 0;
}
