/* destination: where the pictures of -o go; one meaning for every command (docs/JOBS.md, "Where files go").
 *
 * A path that ends in .exr, .png or .jpg is that one file, and only that format is written. A folder, and a
 * path that ends in '/', gets the files under their own names. For what is neither: a job's files have the
 * job's name, so fetch, develop and submit take it as a folder; render gives its files the last part of the
 * path as their name. Folders are made if they are missing.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

struct destination {
    char *folder, *base;        /* owned; base is the file's name without extension; NULL: the job's */
    unsigned formats;           /* enum output_format */
    int numbered;               /* several frames: the frame's number goes into the name */
    const char *jpeg_extension; /* as the user writes it: "jpg" or "jpeg" */
};

/* render's -o. NULL: files in the current folder, named after the scene. `formats`: the files to
 * write, 0 for the usual two if the path does not decide. ERR_USAGE if path and formats disagree. */
status destination_init(struct destination *d, const char *out, unsigned formats, const char *scene_name,
                        uint32_t frames, struct error *err) MUST_CHECK;
/* The -o of commands that bring a job's files. NULL: this folder. `formats` are those that the command
 * brings. ERR_USAGE. */
status destination_of_job(struct destination *d, const char *out, unsigned formats, struct error *err) MUST_CHECK;
void destination_release(struct destination *d);

/* Is the path a folder, or does it end in '/'? */
int destination_is_folder(const char *path);

/* Append a frame's path: FOLDER/BASE.EXT, or FOLDER/BASE-0001.EXT when numbered. */
void destination_path(const struct destination *d, uint32_t frame, const char *extension, struct buffer *path);
