/* import: scenes that are submitted by uploading their files.
 *
 *   POST /imports --> OPEN --PUT files, again and again--> OPEN
 *   POST /imports/N: OPEN --> WAITING --a place is free--> RUNNING --a job--> DONE: its files go
 *                      ^-- an error, the client vanished, "keep": true --/
 *   DELETE, an hour without use, the coordinator's start: gone
 *
 * `azulejo submit`, the program beside this one, reads the files (child.h), so every format and every
 * option is what it is on the command line. It has the page's key and is limited to the uploaded files.
 * The files are in FOLDER/imports/N, which is no part of what a store keeps: a copy leaves it out and
 * --keep and --store-limit remove nothing for its sake. An upload belongs to the token that began it; to others
 * it does not exist. Asking again to run it after a lost answer makes no second job.
 */
#pragma once

#include "common/base/status.h"
#include "web/api/request.h"

struct imports;
struct web;

enum {
    IMPORTS_MAX = 64,              /* uploads at a time, */
    IMPORTS_EACH_MAX = 8,          /* of one token, */
    IMPORTS_RUNNING_MAX = 2,       /* and those that are being imported */
    IMPORT_FILES_MAX = 10000,
    IMPORT_WRITES_MAX = 64,        /* files that arrive at the same time, of all uploads */
    IMPORT_IDLE_S = 3600,
    IMPORT_RUN_S = 1800,           /* an import takes at most so long, */
    IMPORT_PROCESSOR_S = 3600,     /* and so many core-seconds */
};
#define IMPORT_TOKEN_BYTES ((uint64_t)16 << 30)   /* of all uploads of one token */
#define IMPORT_FREE_BYTES ((uint64_t)1 << 30)     /* stay free on the disk, or a tenth of it if that is less */

status imports_new(struct imports **out, struct web *web, struct error *err) MUST_CHECK;
/* Starts threads. What an earlier run left is removed. */
status imports_begin(struct imports *imports, struct error *err) MUST_CHECK;
const char *imports_program(const struct imports *imports); /* that is run; NULL: none is known */
const char *imports_folder(const struct imports *imports);
void imports_tick(struct imports *imports, uint64_t now_ns);
/* Kill what runs; its handles close. */
void imports_stop(struct imports *imports);
/* When the loop has ended. NULL is fine. */
void imports_free(struct imports *imports);

/* Handlers. */
void import_begin(struct web_request *request);  /* POST /imports */
void import_file(struct web_request *request);   /* PUT /imports/{import}/files/{path...} */
void import_run(struct web_request *request);    /* POST /imports/{import} */
void import_remove(struct web_request *request); /* DELETE /imports/{import} */
