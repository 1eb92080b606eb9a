/* fetch: outputs of a job, from the coordinator into files. */
#pragma once

#include "client/terminal/frame_list.h"
#include "client/follow/claims.h"
#include "client/follow/destination.h"
#include "client/link/connection.h"
#include "client/follow/follow.h"
#include "client/follow/job_info.h"
#include "client/options/output.h"
#include "common/base/buffer.h"

/* An 8 GiB output is 26,000 pixels square in 32-bit floats, far above what a job may have. */
#define FETCH_BYTES_MAX ((uint64_t)8 << 30)

/* What a preview shows; zeros: the coordinator did not say it. */
struct preview_shows {
    double covered; /* the share of its tiles that have samples, 0..1 */
    double samples; /* of a pixel, the mean */
};

/* Append one output file to `data`. */
status fetch_output(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind,
                    struct buffer *data, struct error *err) MUST_CHECK;

/* Create the folder and check that files can be written there, before expensive work. ERR_IO. */
status fetch_check_folder(const char *folder, struct error *err) MUST_CHECK;

/* The same, unless the file has the digest `have` (NULL: none); then *unchanged is set. */
status fetch_output_unless(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind,
                           const struct digest *have, int *unchanged, struct buffer *data,
                           struct error *err) MUST_CHECK;

/* Bringing a job's files to a destination. A file that is there and is the coordinator's, by its
 * digest, is not sent again. Zero what is not given; job_fetch_release frees the rest. */
struct job_fetch {
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    struct destination to; /* its formats that the job does not have are ignored */
    int manifest;          /* these too */
    int force;             /* use the job's plain name even if it is taken (client/follow/claims.h) */
    int finished_only;     /* frames that are not rendered yet do not count as missing */
    const char *video;     /* a video of the pictures that are there; NULL: none */
    int json;              /* fill `files` and `missing` instead of printing a line for each file */
    json_t *files, *missing;
    json_t *preview;                      /* what job_fetch_preview brought */
    Azulejo__Wire__OutputSettings *look;  /* how the preview is tone mapped; NULL: as the job */
    size_t fetched, failed, not_rendered; /* files that are here; files; frames */
    size_t unchanged;                     /* of the files that are here, those that were there already */
    struct claim claim;                   /* made when the first file has arrived */
    struct buffer found;                  /* the base name of an older claim; empty: none */
    int sought;                           /* `found` is known */
    struct error first;                   /* the first file's failure */
    int again;                            /* files may be brought a second time */
    uint8_t *followed; /* of each frame, FETCH_GOT and FETCH_TRIED of its kinds; NULL: once is enough */
};
enum {
    FETCH_KINDS = 4,     /* EXR, PNG, JPEG, manifest: the formats' bits and one more */
    FETCH_MANIFEST = 1 << OUTPUT_FORMAT_COUNT,
};
#define FETCH_GOT(kind) (1u << (kind))
#define FETCH_TRIED(kind) (1u << ((kind) + FETCH_KINDS))
void job_fetch_release(struct job_fetch *f);

#define JOB_FETCH_FORCE_ROW(flag)                                                                 \
    {"force", 'f', OPTION_FLAG, &(flag), NULL,                                                    \
     "name the files after the job even if that overwrites another job's", 0, 0, NULL}

/* `job` is known now, and so many of its frames are to be brought. ERR_NOT_FOUND: it makes no such file. */
status job_fetch_begin(struct job_fetch *f, size_t frames, struct error *err) MUST_CHECK;

/* The kinds of files to bring. */
unsigned job_fetch_kinds(const struct job_fetch *f);

/* Is the bit of a frame set in one of the job's lists of frames? */
int job_frame_listed(const Azulejo__Wire__JobInfo *job, const ProtobufCBinaryData *list, uint32_t frame);

/* Files of one frame that is being followed, of the kinds of the mask that were not brought or
 * tried. A file that the coordinator cannot send is no error. */
status job_fetch_some(struct job_fetch *f, uint32_t frame, unsigned kinds, struct error *err) MUST_CHECK;

/* A preview to `path`. */
status job_fetch_preview(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, const char *path,
                         struct error *err) MUST_CHECK;

/* The files of every finished frame, or of those of the list that has any. Files that the coordinator cannot send do
 * not stop the others: ERR_INCOMPLETE at the end, or, if there was no file at all, the first file's error,
 * ERR_NOT_FOUND if no frame is finished. ERR_IO when a file cannot be written. */
status job_fetch_pictures(struct job_fetch *f, const struct frame_list *only, struct error *err) MUST_CHECK;

/* fetch_video.c: the video of the chosen frames that have pictures. */
status job_fetch_video(struct job_fetch *f, const struct frame_list *only, struct error *err) MUST_CHECK;
/* Append a frame's picture: from the file, if it was brought. */
status job_fetch_picture(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, struct buffer *data,
                         struct error *err) MUST_CHECK;

/* {"files": [...], "unchanged": 2, "missing": [{"frame": 3, "file": "png", "error": "..."}]}, and of a preview
 * "preview": {"frame": 3, "covered": 0.12, "samples": 2, "spp": 64}; a new reference. */
json_t *job_fetch_json(const struct job_fetch *f);

/* fetch_follow.c: bring the chosen files of a job as they are finished, until it has ended, over as
 * many connections as needed. `how->json`: print {"job": ..., "files": ...} at the end. Errors as of
 * follow_job, then as of job_fetch_pictures. */
status job_fetch_follow(struct connection **c, uint64_t job, struct job_fetch *f, const struct frame_choice *choice,
                        const struct follow *how, struct error *err) MUST_CHECK;
