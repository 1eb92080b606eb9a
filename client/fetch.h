/* fetch: outputs of a job, from the coordinator into files. */
#ifndef AZULEJO_CLIENT_FETCH_H
#define AZULEJO_CLIENT_FETCH_H

#include "client/connection.h"
#include "client/job_info.h"
#include "common/base/buffer.h"

/* An 8 GiB output is 26,000 pixels square in 32-bit floats, far above what a job may have. */
#define FETCH_BYTES_MAX ((uint64_t)8 << 30)

/* Append one output file to `data`. */
status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err) MUST_CHECK;

/* Make the folder and prove that files can be written there, before anything costly is
 * done. ERR_IO. */
status fetch_check_folder(const char *folder, struct error *err) MUST_CHECK;

/* Bringing a job's files into a folder. */
struct job_fetch {
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    const char *folder;
    unsigned formats; /* enum output_format; those that the job does not have do not count */
    int manifest;     /* these too */
    json_t *files;    /* NULL: print a line for each */
    size_t fetched, not_ready; /* files; frames */
};

/* One file; `path` NULL: into the folder, named after the job. */
status job_fetch_file(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                      const char *path, struct error *err) MUST_CHECK;

/* The files of every finished frame, or of only_frame (negative: all). ERR_NOT_FOUND when there is
 * none. */
status job_fetch_pictures(struct job_fetch *f, int64_t only_frame, struct error *err) MUST_CHECK;

#endif
