/* measured: the part of a picture's file that differs between farms and runs: times, workers, the
 * job's number. It is one JSON text, the header attribute MEASURED_ATTRIBUTE, so that the rest of
 * the file is a function of the scene and the settings. */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/film/film.h"

#define MEASURED_ATTRIBUTE "azulejo:measured"

struct measured {
    uint64_t job;
    uint32_t workers;                 /* that delivered the film's results; 0: not known */
    int64_t submitted_at, written_at; /* seconds since 1970, UTC */
    uint64_t cpu_ns, trace_ns;        /* of results since the coordinator's last start */
};

/* How many workers the film's results came from. */
uint32_t measured_workers(const struct film *film);
/* Append their numbers, 32 bits each, little-endian. ERR_NO_MEMORY. */
status measured_deliverers(const struct film *film, struct buffer *out, struct error *err) MUST_CHECK;
void measured_write(struct buffer *out, const struct measured *m);
