/* submission: a scene file on its way to becoming a job. */
#pragma once

#include "client/link/connection.h"
#include "client/import/import.h"
#include "client/options/job_options.h"

/* Read the scene and complete the request; warnings go to standard error unless `quiet`.
 * `scene` is released by the caller in every case. */
status submission_prepare(const char *path, const struct job_options *options, int quiet, struct job_request *request,
                          struct import_result *scene, struct error *err) MUST_CHECK;

/* Send what the coordinator lacks: the scene and its blobs, and the operator's file if `request` has
 * one. The number of files and the upload's progress go to standard error, unless `quiet`. */
status submission_upload(struct connection *c, const struct import_result *scene, const struct job_request *request,
                         int quiet, struct error *err) MUST_CHECK;

/* The same, then the job. */
status submission_send(struct connection *c, const struct import_result *scene, const struct job_request *request,
                       const char *name, unsigned formats, int quiet, struct job_accepted *out,
                       struct error *err) MUST_CHECK;

/* A job's name from a scene's path: the file's name without folder and extension. The caller frees with mem_free. */
char *submission_name(const char *path);
