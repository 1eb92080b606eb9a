/* Embree's own threads, which build BVHs. Their library (oneTBB 2021.8) starts them as devices come and go, and ends the
 * process where one cannot be started: so all are started at once, after others like them. */
#include <embree3/rtcore.h>
#include <string.h>

#include "common/system/parallel.h"
#include "worker/render/render.h"

/* What oneTBB gives each thread. */
enum { STACK_BYTES = 4 << 20 };

static RTCDevice keeper; /* keeps them until the process ends; they sleep where a device has fewer threads */

status render_start_builders(struct error *err)
{
    const unsigned processors = parallel_processors();
    int error;

    if (keeper)
        return STATUS_OK;
    error = parallel_try(processors, STACK_BYTES);
    if (error)
        return error_set(err, STATUS_ERR_NO_MEMORY,
                         "the %u threads that build BVHs cannot be started (%s): memory is short, or the number of "
                         "threads is limited",
                         processors, strerror(error));
    keeper = rtcNewDevice("start_threads=1,set_affinity=0");
    return keeper ? STATUS_OK : error_no_memory(err, "Embree's threads");
}
