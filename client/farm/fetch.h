/* fetch: outputs of a job, from the coordinator into files. */
#ifndef AZULEJO_CLIENT_FETCH_H
#define AZULEJO_CLIENT_FETCH_H

#include "client/farm/claims.h"
#include "client/farm/connection.h"
#include "client/farm/job_info.h"
#include "common/base/buffer.h"

/* An 8 GiB output is 26,000 pixels square in 32-bit floats, far above what a job may have. */
#define FETCH_BYTES_MAX ((uint64_t)8 << 30)

/* Append one output file to `data`. */
status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err) MUST_CHECK;

/* Make the folder and prove that files can be written there, before anything costly is
 * done. ERR_IO. */
status fetch_check_folder(const char *folder, struct error *err) MUST_CHECK;

/* Bringing a job's files into a folder. Zero what is not given; job_fetch_release frees the
 * rest. */
struct job_fetch {
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    const char *folder;
    unsigned formats;    /* enum output_format; those that the job does not have do not count */
    int manifest;        /* these too */
    int force;           /* under the job's plain name, whatever is there (client/farm/claims.h) */
    int finished_only;   /* frames that are not rendered yet are not missed */
    int json;            /* fill `files` and `missing` instead of printing a line for each file */
    json_t *files, *missing;
    size_t fetched, failed, not_rendered; /* files; files; frames */
    struct claim claim;  /* taken when the first file is there */
    struct error first;  /* why the first file that failed did */
};
void job_fetch_release(struct job_fetch *f);

#define JOB_FETCH_FORCE_ROW(flag)                                                                 \
    {"force", 'f', OPTION_FLAG, &(flag), NULL,                                                    \
     "name the files after the job even where that overwrites another job's", 0, 0, NULL}

/* One file to `path`. */
status job_fetch_file(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                      const char *path, struct error *err) MUST_CHECK;

/* The files of every finished frame, or of only_frame (negative: all). What the coordinator cannot
 * give does not keep the rest back: ERR_INCOMPLETE at the end, or, when there was nothing at all,
 * the first file's error, ERR_NOT_FOUND where no frame is finished. ERR_IO when a file cannot be
 * written. */
status job_fetch_pictures(struct job_fetch *f, int64_t only_frame, struct error *err) MUST_CHECK;

/* {"files": [...], "missing": [{"frame": 3, "file": "png", "error": "..."}]}; a new reference. */
json_t *job_fetch_json(const struct job_fetch *f);

#endif
