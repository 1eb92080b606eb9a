/* A scene's files are there: run `azulejo submit` on them. */
#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "web/base/access.h"
#include "web/base/control.h"
#include "web/uploads/import_parts.h"
#include "web/web.h"

extern char **environ;

enum {
    BODY_BYTES_MAX = 64 << 10,
    OUTPUT_BYTES = 16 << 20,       /* it lists the files that it read */
    TEXT_SIZE = 1024,
    ADDRESS_SIZE = 32,
    OWN_WORDS = 16,                /* of the command line, besides the options */
};
#define MEMORY_BYTES ((uint64_t)16 << 30) /* or half of the machine's, if that is less */

/* ---- the answer --------------------------------------------------------------------------- */

static uint64_t memory_limit(void)
{
    long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    uint64_t half = pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size / 2 : MEMORY_BYTES;

    return half < MEMORY_BYTES ? half : MEMORY_BYTES;
}

/* What the program's exit status means here (common/base/status.h). */
static status code_of(int64_t exit_status)
{
    switch (exit_status) {
    case 2: return STATUS_ERR_USAGE;
    case 3: return STATUS_ERR_INPUT;
    case 5: return STATUS_ERR_REFUSED;
    case 4:
    case 7:
    case 8: return STATUS_ERR_IO;
    default: return STATUS_ERR_INTERNAL;
    }
}

/* Why there is no job. */
static void explain(const struct import *import, const struct web_child_result *r, struct error *err)
{
    char text[TEXT_SIZE];
    int too_much = r->signal == SIGABRT || r->signal == SIGSEGV;

    import_sentence(text, sizeof text, buffer_text(r->errors), import->folder);
    if (r->end == CHILD_TOO_LONG || r->signal == SIGXCPU)
        error_set(err, STATUS_ERR_LIMIT,
                  "reading the scene took longer than an upload may (%d minutes): use 'azulejo submit'",
                  IMPORT_RUN_S / 60);
    else if (r->end == CHILD_TOO_MUCH)
        error_set(err, STATUS_ERR_LIMIT, "the scene's import printed too much: use 'azulejo submit'");
    else if (r->end == CHILD_KILLED)
        error_set(err, STATUS_ERR_REFUSED, "the upload was removed while it was imported");
    else if (too_much || strstr(text, "out of memory"))
        error_set(err, STATUS_ERR_LIMIT,
                  "the scene needs more memory than an upload may (%" PRIu64 " MiB), or its import failed: use "
                  "'azulejo submit'%s%s", memory_limit() >> 20, text[0] ? ": " : "", text);
    else if (text[0])
        error_set(err, code_of(r->exit_status), "%s", text);
    else
        error_set(err, STATUS_ERR_INTERNAL,
                  "the scene's import ended without a word (status %d, signal %d); the coordinator's log has more",
                  (int)r->exit_status, r->signal);
}

/* {"job": 12, "estimate_spp": 0, "warnings": []} out of what the program printed. */
static json_t *answer_of(const struct import *import, const struct web_child_result *r)
{
    json_t *said = json_loadb((const char *)r->output->data, r->output->size, 0, NULL);
    const json_t *job = json_object_get(said, "job"), *spp = json_object_get(said, "estimate_spp");
    json_t *answer = NULL;

    if (r->end == CHILD_EXITED && r->signal == 0 && r->exit_status == 0 && json_is_integer(job))
        answer = json_pack("{s:I, s:I, s:o}", "job", json_integer_value(job), "estimate_spp", json_integer_value(spp),
                           "warnings", import_warnings(buffer_text(r->errors), import->folder));
    json_decref(said);
    return answer;
}

static void note(const struct import *import, const char *peer, uint64_t job, const struct error *why)
{
    char details[64];

    snprintf(details, sizeof details, "{\"token\": %" PRIu64 ", \"files\": %u}", import->token, import->files);
    access_note(import->all->web, "import", import->who, peer, "web", job, details, why);
}

/* Its job is known: keep only the answer. */
static void done(struct import *import, json_t *answer)
{
    char *text = json_dumps(answer, JSON_COMPACT);

    import->state = IMPORT_DONE;
    buffer_puts(&import->answer, text ? text : "{}");
    free(text);
    import->bytes = 0;
    if (!trash_take(import->all->folder, import->folder))
        log_warn("%s: cannot be removed: %s", import->folder, strerror(errno));
}

static void on_end(void *user, const struct web_child_result *r)
{
    struct import *import = user;
    struct imports *all = import->all;
    struct web_request *asking = import->asking;
    struct error err = {0};
    json_t *answer = answer_of(import, r);
    uint64_t job = (uint64_t)json_integer_value(json_object_get(answer, "job"));

    import->child = NULL;
    import_relay_end(import->relay);
    import->relay = NULL;
    import->asking = NULL;
    import->state = IMPORT_OPEN;
    all->running--;
    if (!answer)
        explain(import, r, &err);
    note(import, asking ? asking->peer : "", job, answer ? NULL : &err);
    if (!answer)
        log_info("an upload of %s was not submitted: %s", import->who, err.text);
    if (answer && !import->removed && !import->keep)
        done(import, answer);
    if (asking)
        asking->state = NULL;
    if (asking && answer)
        import_answer(asking, 201, json_incref(answer));
    else if (asking)
        import_fail(asking, &err);
    json_decref(answer);
    import_settle(import);
    imports_pump(all);
}

/* ---- running ------------------------------------------------------------------------------ */

/* A descriptor with the key of the import's relay, and with no key of the farm. The program reads it by its name below
 * /proc/self/fd, so no one sees it in a command line, an environment or a folder. Wipes `text`. */
static int make_secret(struct buffer *text, struct error *err)
{
    int fd = memfd_create("azulejo-key", MFD_CLOEXEC);

    if (fd < 0 || fchmod(fd, 0600) != 0 || write(fd, text->data, text->size) != (ssize_t)text->size) {
        error_set(err, STATUS_ERR_IO, "no memory file for a key: %s", strerror(errno));
        if (fd >= 0)
            close(fd);
        fd = -1;
    }
    buffer_wipe(text);
    return fd;
}

/* This process's environment without Azulejo's own variables, and with the key. The caller frees the array only. */
static const char **make_environment(void)
{
    static const char key[] = "AZULEJO_KEY=/proc/self/fd/3";
    size_t count = 0, kept = 0;
    const char **out;

    while (environ[count])
        count++;
    out = mem_calloc(count + 2, sizeof *out);
    for (size_t i = 0; out && i < count; i++)
        if (strncmp(environ[i], "AZULEJO_", strlen("AZULEJO_")) != 0)
            out[kept++] = environ[i];
    if (out)
        out[kept] = key;
    return out;
}

static status start(struct import *import, struct error *err)
{
    struct imports *all = import->all;
    char address[ADDRESS_SIZE], token[64];
    const char *words[OWN_WORDS + IMPORT_OPTIONS_MAX] = {
        "azulejo", "submit", import->scene, "--json", "--reconnect=0", "--only-below=.", "--coordinator", address,
        "--token", token, "--owner", import->who};
    size_t count = 0;
    char *folder = file_join(import->folder, "files");
    const char **environment = make_environment();
    struct buffer key = BUFFER_INIT;
    uint16_t port = 0;
    int secret = -1;
    status s = import_relay_new(&import->relay, &all->web->farm, &port, &key, err);

    while (words[count])
        count++;
    memcpy(words + count, import->words.items, import->words.count * sizeof *words);
    if (s == STATUS_OK && (secret = make_secret(&key, err)) < 0)
        s = err->code;
    buffer_wipe(&key);
    snprintf(address, sizeof address, "127.0.0.1:%u", port);
    if (import->keep) /* each of these is a job of its own */
        snprintf(token, sizeof token, "upload-%" PRIu64 "-%" PRIu32, import->number, ++import->runs);
    else
        snprintf(token, sizeof token, "upload-%" PRIu64, import->number);
    if (s == STATUS_OK && (!folder || !environment))
        s = error_no_memory(err, "an import");
    if (s == STATUS_OK) {
        const struct web_child_options how = {
            .program = all->client, .arguments = words, .environment = environment, .folder = folder,
            .wall_port = port,
            .secret = secret, .memory_bytes = memory_limit(), .processor_s = IMPORT_PROCESSOR_S,
            .limit_ms = IMPORT_RUN_S * UINT64_C(1000), .output_bytes = OUTPUT_BYTES};
        s = web_child_start(&import->child, all->web->loop, &how, on_end, import, err);
    }
    if (secret >= 0)
        close(secret);
    if (s != STATUS_OK) {
        import_relay_end(import->relay);
        import->relay = NULL;
    }
    mem_free(folder);
    mem_free(environment);
    return s;
}

void imports_pump(struct imports *imports)
{
    while (!imports->stopped && imports->running < IMPORTS_RUNNING_MAX) {
        struct import *first = NULL;
        struct web_request *asking;
        struct error err = {0};
        for (struct import *i = imports->list; i; i = i->next)
            if (i->state == IMPORT_WAITING)
                first = i; /* the oldest */
        if (!first)
            return;
        first->state = IMPORT_RUNNING;
        if (start(first, &err) == STATUS_OK) {
            imports->running++;
            continue;
        }
        first->state = IMPORT_OPEN;
        asking = first->asking;
        first->asking = NULL;
        if (asking) {
            asking->state = NULL;
            import_fail(asking, &err);
        }
    }
}

void import_stop_running(struct import *import)
{
    struct web_request *asking = import->asking;
    struct error err = {0};

    if (import->state == IMPORT_RUNNING && import->child)
        web_child_kill(import->child); /* on_end answers */
    if (import->state != IMPORT_WAITING)
        return;
    import->state = IMPORT_OPEN;
    import->asking = NULL;
    if (!asking)
        return;
    asking->state = NULL;
    error_set(&err, STATUS_ERR_REFUSED, "the upload was removed before it was imported");
    import_fail(asking, &err);
}

static void on_gone(struct web_request *request)
{
    struct import *import = request->state;

    if (!import)
        return;
    request->state = NULL;
    import->asking = NULL;
    import_stop_running(import);
}

/* ---- the request -------------------------------------------------------------------------- */

/* {"scene": "path", "options": [...], "keep": false} */
static status read_body(struct import *import, const struct buffer *body, struct error *err)
{
    json_error_t where;
    json_t *said = body->size > 0 && body->size <= BODY_BYTES_MAX
                       ? json_loadb((const char *)body->data, body->size, JSON_REJECT_DUPLICATES, &where)
                       : NULL;
    const char *scene = json_string_value(json_object_get(said, "scene")), *name;
    struct buffer path = BUFFER_INIT;
    const json_t *keep = json_object_get(said, "keep");
    json_t *value;
    status s = STATUS_OK;

    if (!scene)
        s = error_set(err, STATUS_ERR_USAGE,
                      "the body must be JSON as in {\"scene\": \"room.gltf\", \"options\": [\"--spp\", \"64\"]}");
    if (s == STATUS_OK)
        json_object_foreach(said, name, value) if (strcmp(name, "scene") != 0 && strcmp(name, "options") != 0 &&
                                                   strcmp(name, "keep") != 0) s =
            error_set(err, STATUS_ERR_USAGE, "the body may have 'scene', 'options' and 'keep', not '%.64s'", name);
    if (s == STATUS_OK && keep && !json_is_boolean(keep))
        s = error_set(err, STATUS_ERR_USAGE, "keep: must be true or false");
    import->keep = json_is_true(keep);
    THEN(s, import_path_check(scene, err));
    THEN(s, import_words_read(&import->words, json_object_get(said, "options"), err));
    if (s == STATUS_OK) {
        buffer_printf(&path, "./%s", scene);
        import->scene = buffer_ok(&path) ? mem_strdup(buffer_text(&path)) : NULL;
        s = import->scene ? STATUS_OK : error_no_memory(err, "a path");
    }
    buffer_release(&path);
    json_decref(said);
    return s;
}

static status check(const struct import *import, struct error *err)
{
    if (import->state != IMPORT_OPEN)
        return error_set(err, STATUS_ERR_REFUSED, "the upload is being imported already");
    if (import->writes > 0)
        return error_set(err, STATUS_ERR_REFUSED, "%u files of the upload are still arriving", import->writes);
    if (import->files == 0)
        return error_set(err, STATUS_ERR_USAGE, "nothing was uploaded: PUT the scene's files first");
    return web_store_usable(import->all->web, err);
}

void import_run(struct web_request *request)
{
    struct import *import = NULL;
    struct error err = {0};
    status s = import_find(request, &import, &err);

    if (s == STATUS_OK && import->state == IMPORT_DONE) {
        web_answer(request, 201, "application/json", NULL, import->answer.data, import->answer.size);
        return;
    }
    THEN(s, check(import, &err));
    if (s == STATUS_OK) {
        mem_free(import->scene);
        import->scene = NULL;
        import_words_release(&import->words);
        s = read_body(import, &request->body, &err);
    }
    if (s != STATUS_OK) {
        import_fail(request, &err);
        return;
    }
    import->state = IMPORT_WAITING;
    import->asking = request;
    request->state = import;
    request->on_gone = on_gone;
    imports_pump(import->all);
}
