/* The function of a verb that only the programs of `make tables` have: its row and its message are in the Makefile. */
#include "coordinator/steering/steer.h"

status steer_salute(const struct steering *s, struct error *err)
{
    (void)err;
    farm_note(s->farm, s->job, s->who, "saluted: %.100s", s->message->job_salute->words);
    return STATUS_OK;
}
