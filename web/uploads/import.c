#include "web/uploads/import.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "web/base/control.h"
#include "web/base/wall.h"
#include "web/uploads/import_parts.h"
#include "web/base/problem.h"
#include "web/web.h"

enum { PATH_BYTES = 4096, NUMBER_BITS = 48 };

/* ---- the table ---------------------------------------------------------------------------- */

/* The program `azulejo` that was installed with this one. NULL: not known. */
static char *client_beside(void)
{
    char path[PATH_BYTES];
    ssize_t length = readlink("/proc/self/exe", path, sizeof path - 1);
    char *folder = NULL, *out;

    if (length <= 0)
        return NULL;
    path[length] = 0;
    folder = file_dirname(path);
    out = folder ? file_join(folder, "azulejo") : NULL;
    mem_free(folder);
    return out;
}

/* Its files go to the trash, so that no request waits for the disk. */
static void discard(const struct imports *all, const char *folder)
{
    if (!trash_take(all->folder, folder) && errno != ENOENT)
        log_warn("%s: cannot be removed: %s", folder, strerror(errno));
}

/* What an earlier run left. */
static void discard_all(const struct imports *all)
{
    DIR *entries = opendir(all->folder);
    const struct dirent *entry;

    while (entries && (entry = readdir(entries))) {
        char *path = entry->d_name[0] >= '0' && entry->d_name[0] <= '9' ? file_join(all->folder, entry->d_name) : NULL;
        if (path)
            discard(all, path);
        mem_free(path);
    }
    if (entries)
        closedir(entries);
}

status imports_new(struct imports **out, struct web *web, struct error *err)
{
    struct imports *all = mem_calloc(1, sizeof *all);
    char *trash;
    status s = STATUS_OK;

    *out = NULL;
    NEED(all, err, "uploads");
    all->web = web;
    wall_words(web->wall, sizeof web->wall);
    wall_lacks(web->wall_lacks, sizeof web->wall_lacks);
    if (strlen(web->wall) < strlen("files, network, system calls"))
        log_warn("strangers' files are read without a whole wall around the program that reads them: this kernel has %s; "
                 "see docs/WEB.md", web->wall[0] ? web->wall : "no Landlock and no seccomp");
    all->folder = file_join(web->options.folder, "imports");
    all->client = web->options.client ? mem_strdup(web->options.client) : client_beside();
    trash = all->folder ? file_join(all->folder, "trash") : NULL;
    if (!trash)
        s = error_no_memory(err, "uploads");
    else
        (void)!file_make_private_folder(trash, err); /* without a disk there are no uploads for now */
    mem_free(trash);
    if (s == STATUS_OK)
        *out = all;
    else
        imports_free(all);
    return s;
}

status imports_begin(struct imports *all, struct error *err)
{
    char *trash = file_join(all->folder, "trash");
    status s = trash ? STATUS_OK : error_no_memory(err, "uploads");

    if (trash && access(trash, W_OK) == 0)
        s = trash_open(&all->trash, all->folder, err);
    mem_free(trash);
    if (s == STATUS_OK)
        discard_all(all);
    return s;
}

const char *imports_program(const struct imports *imports) { return imports->client; }
const char *imports_folder(const struct imports *imports) { return imports->folder; }

static void import_free(struct import *import)
{
    for (struct import **at = &import->all->list; *at; at = &(*at)->next)
        if (*at == import) {
            *at = import->next;
            import->all->count--;
            break;
        }
    import_words_release(&import->words);
    buffer_release(&import->answer);
    mem_free(import->scene);
    mem_free(import->folder);
    mem_free(import);
}

void import_settle(struct import *import)
{
    if (import->removed && import->writes == 0 && !import->child)
        import_free(import);
}

void import_drop(struct import *import)
{
    if (import->removed)
        return;
    import->removed = 1;
    import->writes++; /* it lives until the end of this */
    import_writes_stop(import);
    import_stop_running(import);
    if (import->folder)
        discard(import->all, import->folder);
    import->writes--;
    import_settle(import);
}

void imports_tick(struct imports *imports, uint64_t now_ns)
{
    struct import *next;

    for (struct import *i = imports->list; i; i = next) {
        next = i->next;
        if (i->writes > 0 || i->child || i->state == IMPORT_WAITING)
            i->used_ns = now_ns;
        else if (now_ns > i->used_ns && now_ns - i->used_ns > IMPORT_IDLE_S * UINT64_C(1000000000))
            import_drop(i);
    }
    imports_pump(imports);
}

void imports_stop(struct imports *imports)
{
    imports->stopped = 1;
    for (struct import *i = imports->list; i; i = i->next) {
        if (i->child)
            web_child_abandon(i->child);
        import_relay_end(i->relay);
        i->relay = NULL;
        i->child = NULL;
        i->asking = NULL;
    }
}

void imports_free(struct imports *imports)
{
    if (!imports)
        return;
    while (imports->list) {
        import_writes_stop(imports->list);
        discard(imports, imports->list->folder);
        import_free(imports->list);
    }
    trash_close(imports->trash);
    mem_free(imports->client);
    mem_free(imports->folder);
    mem_free(imports);
}

/* ---- handlers ----------------------------------------------------------------------------- */

/* What is wrong with an upload is a value or a state, not the request's form. */
void import_fail(struct web_request *request, const struct error *why)
{
    problem_answer(request, problem_of_farm(why->code), why->text);
}

void import_answer(struct web_request *request, unsigned http_status, json_t *body)
{
    char *text = body ? json_dumps(body, JSON_COMPACT) : NULL;
    struct error err = {0};

    json_decref(body);
    if (!text) {
        error_no_memory(&err, "an answer");
        import_fail(request, &err);
        return;
    }
    web_answer(request, http_status, "application/json", NULL, text, strlen(text));
    free(text);
}

status import_find(struct web_request *request, struct import **out, struct error *err)
{
    struct imports *all = request->web->imports;
    const char *text = request->parameters[0];
    char *end;
    uint64_t number = strtoull(text, &end, 10);

    *out = NULL;
    for (struct import *i = all->list; i && !*end && text[0] >= '0' && text[0] <= '9'; i = i->next)
        if (i->number == number && i->token == request->caller.token && !i->removed) {
            i->used_ns = clock_monotonic_ns();
            *out = i;
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "no such upload: it was removed, or not used for an hour, or the coordinator was started "
                     "again; begin a new one with POST /api/v1/imports");
}

/* A place for one more; the oldest ones whose job is known make room. */
static status make_place(struct imports *all, uint64_t token, struct error *err)
{
    uint32_t own = 0;
    struct import *done = NULL;

    for (struct import *i = all->list; i; i = i->next) {
        own += i->token == token && i->state != IMPORT_DONE;
        if (i->state == IMPORT_DONE && !i->removed)
            done = i; /* the list ends with the oldest */
    }
    if (own >= IMPORTS_EACH_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%d uploads were begun with this token and not submitted: submit or delete one first",
                         IMPORTS_EACH_MAX);
    if (all->count >= IMPORTS_MAX && done)
        import_drop(done);
    if (all->count >= IMPORTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d uploads are open: try again when one has ended", IMPORTS_MAX);
    return STATUS_OK;
}

/* Numbers are random: one of before a restart means nothing afterwards. */
static status make_number(struct import *import, struct error *err)
{
    uint64_t number = 0;

    if (getrandom(&number, sizeof number, 0) != sizeof number)
        return error_set(err, STATUS_ERR_IO, "no random numbers: %s", strerror(errno));
    import->number = (number >> (64 - NUMBER_BITS)) | 1;
    return STATUS_OK;
}

static status make_folders(struct import *import, struct error *err)
{
    static const char *const parts[] = {"files", "tmp"};
    struct buffer path = BUFFER_INIT;
    status s = STATUS_OK;

    buffer_printf(&path, "%s/%" PRIu64, import->all->folder, import->number);
    import->folder = buffer_ok(&path) ? mem_strdup(buffer_text(&path)) : NULL;
    buffer_release(&path);
    for (int i = 0; i < 2 && s == STATUS_OK; i++) {
        char *part = import->folder ? file_join(import->folder, parts[i]) : NULL;
        s = part ? file_make_scratch_folder(part, err) : error_no_memory(err, "an upload");
        mem_free(part);
    }
    return s;
}

static status begin(struct web_request *request, struct import **out, struct error *err)
{
    struct imports *all = request->web->imports;
    struct import *import = NULL;
    status s = web_store_usable(all->web, err);

    if (s == STATUS_OK && (!all->client || access(all->client, X_OK) != 0))
        s = error_set(err, STATUS_ERR_UNSUPPORTED,
                      "this coordinator has no program 'azulejo' beside it that reads scenes: name it with "
                      "--client-program, or submit with 'azulejo submit'");
    THEN(s, make_place(all, request->caller.token, err));
    if (s != STATUS_OK)
        return s;
    import = mem_calloc(1, sizeof *import);
    NEED(import, err, "an upload");
    import->all = all;
    import->token = request->caller.token;
    memcpy(import->who, request->caller.who, sizeof import->who);
    import->used_ns = clock_monotonic_ns();
    import->next = all->list;
    all->list = import;
    all->count++;
    s = make_number(import, err);
    THEN(s, make_folders(import, err));
    if (s != STATUS_OK)
        import_drop(import);
    else
        *out = import;
    return s;
}

void import_begin(struct web_request *request)
{
    struct import *import = NULL;
    struct error err = {0};

    if (begin(request, &import, &err) == STATUS_OK)
        import_answer(request, 201, json_pack("{s:I}", "import", (json_int_t)import->number));
    else
        import_fail(request, &err);
}

void import_remove(struct web_request *request)
{
    struct import *import = NULL;
    struct error err = {0};

    if (import_find(request, &import, &err) != STATUS_OK) {
        import_fail(request, &err);
        return;
    }
    import_drop(import);
    web_answer(request, 204, NULL, NULL, NULL, 0);
}
