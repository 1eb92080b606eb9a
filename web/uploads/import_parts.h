/* import_parts: what import.c, import_file.c and import_run.c share. */
#pragma once

#include <uv.h>

#include "common/system/trash.h"
#include "web/uploads/child.h"
#include "web/uploads/import.h"
#include "web/uploads/import_check.h"
#include "web/uploads/import_relay.h"

enum import_state { IMPORT_OPEN, IMPORT_WAITING, IMPORT_RUNNING, IMPORT_DONE };

struct import {
    struct import *next;
    struct imports *all;
    uint64_t number, token;
    enum import_state state;
    int removed;  /* freed as soon as nothing works on it */
    char *folder; /* FOLDER/imports/NUMBER: files/ and tmp/ */
    uint64_t used_ns;
    uint64_t bytes; /* also of files that are still arriving */
    uint32_t files, folders;
    uint32_t writes; /* files that are arriving */
    char who[WEB_WHO_MAX + 1];
    char *scene; /* "./path"; with the words and `keep`, of the last request to run it */
    int keep;    /* its files stay when the job is there */
    uint32_t runs;
    struct import_words words;
    struct web_request *asking; /* who waits for the job; NULL: vanished */
    struct web_child *child;    /* RUNNING, */
    struct import_relay *relay; /* and its way to the coordinator */
    struct buffer answer;       /* DONE */
};

struct imports {
    struct web *web;
    struct trash *trash; /* folder/trash: what goes */
    char *client;        /* the program `azulejo` */
    char *folder;        /* FOLDER/imports */
    struct import *list; /* newest first */
    struct import_write *writing;
    uint32_t count, running, writes;
    uint64_t last_write; /* number of its temporary file */
    int stopped;
};

/* The caller's own import of the route's first parameter. ERR_NOT_FOUND. */
status import_find(struct web_request *request, struct import **out, struct error *err) MUST_CHECK;
/* Remove its files and, as soon as nothing works on it, itself. */
void import_drop(struct import *import);
/* Something has ended its work on it. */
void import_settle(struct import *import);
void import_fail(struct web_request *request, const struct error *why);
void import_answer(struct web_request *request, unsigned http_status, json_t *body);
/* Who asks vanished, or it is dropped: stop running it. */
void import_stop_running(struct import *import);
/* Begin what waits while there is a place. */
void imports_pump(struct imports *imports);
/* Give up a file that arrives, of this import. */
void import_writes_stop(struct import *import);
