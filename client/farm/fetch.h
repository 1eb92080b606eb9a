/* fetch: outputs of a job, from the coordinator into files. */
#ifndef AZULEJO_CLIENT_FETCH_H
#define AZULEJO_CLIENT_FETCH_H

#include "client/terminal/frame_list.h"
#include "client/farm/claims.h"
#include "client/farm/connection.h"
#include "client/farm/job_info.h"
#include "common/base/buffer.h"

/* An 8 GiB output is 26,000 pixels square in 32-bit floats, far above what a job may have. */
#define FETCH_BYTES_MAX ((uint64_t)8 << 30)

/* What a preview shows; zeros: the coordinator did not say it. */
struct preview_shows {
    double covered; /* the share of its tiles that have samples, 0..1 */
    double samples; /* of a pixel, the mean */
};

/* Append one output file to `data`. */
status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err) MUST_CHECK;

/* Create the folder and check that files can be written there, before expensive work. ERR_IO. */
status fetch_check_folder(const char *folder, struct error *err) MUST_CHECK;

/* Bringing a job's files into a folder. Zero what is not given; job_fetch_release frees the
 * rest. */
struct job_fetch {
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    const char *folder;
    unsigned formats;    /* enum output_format; formats that the job does not have are ignored */
    int manifest;        /* these too */
    int force;           /* use the job's plain name even if it is taken (client/farm/claims.h) */
    int finished_only;   /* frames that are not rendered yet do not count as missing */
    int json;            /* fill `files` and `missing` instead of printing a line for each file */
    json_t *files, *missing;
    json_t *preview;     /* what job_fetch_preview brought */
    size_t fetched, failed, not_rendered; /* files; files; frames */
    struct claim claim;  /* made when the first file has arrived */
    struct error first;  /* the first file's failure */
};
void job_fetch_release(struct job_fetch *f);

#define JOB_FETCH_FORCE_ROW(flag)                                                                 \
    {"force", 'f', OPTION_FLAG, &(flag), NULL,                                                    \
     "name the files after the job even if that overwrites another job's", 0, 0, NULL}

/* A preview to `path`. */
status job_fetch_preview(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                         const char *path, struct error *err) MUST_CHECK;

/* The files of every finished frame, or of those of the list that has any. Files that the coordinator
 * cannot send do not stop the others: ERR_INCOMPLETE at the end, or, if there was no file at all,
 * the first file's error, ERR_NOT_FOUND if no frame is finished. ERR_IO when a file cannot be
 * written. */
status job_fetch_pictures(struct job_fetch *f, const struct frame_list *only,
                          struct error *err) MUST_CHECK;

/* {"files": [...], "missing": [{"frame": 3, "file": "png", "error": "..."}]}, and of a preview
 * "preview": {"frame": 3, "covered": 0.12, "samples": 2, "spp": 64}; a new reference. */
json_t *job_fetch_json(const struct job_fetch *f);

#endif
