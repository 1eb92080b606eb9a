#include "client/follow/cut_frame.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/accuracy/stop.h"
#include "common/scene/settings.h"

/* Of one pixel; 0 if the coordinator sends no size. */
static double mean_samples(const Azulejo__Wire__JobInfo *job, const Azulejo__Wire__CutFrame *cut)
{
    double pixels = job->settings ? (double)job->settings->width * job->settings->height : 0;

    return pixels > 0 ? (double)cut->samples / pixels : 0;
}

int cut_frame_is_cancelled(const Azulejo__Wire__CutFrame *cut)
{
    /* An older coordinator does not send the reason. */
    return cut->end == AZULEJO__WIRE__FRAME_END__FRAME_END_NONE ||
           cut->end == AZULEJO__WIRE__FRAME_END__FRAME_END_CANCEL;
}

const char *cut_frame_text(char out[CUT_FRAME_TEXT_SIZE], const Azulejo__Wire__JobInfo *job,
                           const Azulejo__Wire__CutFrame *cut)
{
    uint32_t spp = job->settings ? job->settings->spp : 0;
    char wanted[16] = "";
    int used;

    if (spp < SETTINGS_SPP_MAX) /* else the job has no cap of its own */
        snprintf(wanted, sizeof wanted, " of %u", spp);
    if (cut_frame_is_cancelled(cut))
        used = snprintf(out, CUT_FRAME_TEXT_SIZE, "frame %u holds %.4g%s samples a pixel (%u to %u)", cut->frame,
                        mean_samples(job, cut), wanted, cut->samples_min, cut->samples_max);
    else
        used = snprintf(out, CUT_FRAME_TEXT_SIZE, "frame %u %s after %u to %u samples a pixel (%.4g)", cut->frame,
                        frame_end_text((enum frame_end)cut->end), cut->samples_min, cut->samples_max,
                        mean_samples(job, cut));

    if (cut->tiles_empty > 0 && used > 0 && used < CUT_FRAME_TEXT_SIZE)
        snprintf(out + used, CUT_FRAME_TEXT_SIZE - (size_t)used, "; %u of %u tiles have none and are black",
                 cut->tiles_empty, cut->tiles);
    return out;
}
