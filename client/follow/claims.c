#include "client/follow/claims.h"

#include <dirent.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "client/terminal/must.h"
#include "common/base/digest.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

enum {
    CANDIDATES_MAX = 100,
    OWNER_SIZE = 128, /* "JOB SUBMITTED SCENE " */
};

struct claims {
    const char *folder;
    struct buffer text; /* of the file */
    struct buffer name; /* the job's plain one */
    char owner[OWNER_SIZE];
    uint64_t job;
};

void claim_plain_name(const Azulejo__Wire__JobInfo *job, struct buffer *name)
{
    char safe[256];
    char *begin = safe;
    size_t length;

    message_text(safe, sizeof safe, job->name);
    for (char *c = safe; *c; c++)
        if (*c == '/' || *c == '?') /* what a control character has become */
            *c = '_';
    while (*begin == '.')
        begin++;
    length = strlen(begin);
    if (length > CLAIM_NAME_BYTES_MAX) {
        length = CLAIM_NAME_BYTES_MAX;
        while (length > 0 && ((unsigned char)begin[length] & 0xc0) == 0x80)
            length--;
    }
    if (length > 0)
        buffer_append(name, begin, length);
    else
        buffer_printf(name, "job-%" PRIu64, job->job);
}

static void candidate(const struct claims *c, int number, struct buffer *base)
{
    buffer_clear(base);
    buffer_append(base, c->name.data, c->name.size);
    if (number > 0)
        buffer_printf(base, "-job%" PRIu64, c->job);
    if (number > 1)
        buffer_printf(base, "-%d", number);
}

/* Does the last claim of this name belong to the job? */
static int is_ours(const struct claims *c, const char *base)
{
    const char *line = buffer_text(&c->text);
    size_t owner = strlen(c->owner), length = strlen(base);
    int ours = 0;

    while (*line) {
        size_t size = strcspn(line, "\n");
        /* The name is everything after the third space. */
        const char *name = line;
        for (int i = 0; i < 3 && name; i++) {
            name = memchr(name, ' ', size - (size_t)(name - line));
            name = name ? name + 1 : NULL;
        }
        if (name && size - (size_t)(name - line) == length && memcmp(name, base, length) == 0)
            ours = (size_t)(name - line) == owner && memcmp(line, c->owner, owner) == 0;
        line += size + (line[size] == '\n');
    }
    return ours;
}

/* Is it BASE.EXTENSION or BASE-0001.EXTENSION, with an extension that fetch writes? */
static int belongs_to(const char *file, const char *base)
{
    static const char *const extensions[] = {"exr", "png", "jpg", MANIFEST_EXTENSION};
    size_t length = strlen(base);

    if (strncmp(file, base, length) != 0)
        return 0;
    file += length;
    if (*file == '-' && file[1] >= '0' && file[1] <= '9')
        file += 1 + strspn(file + 1, "0123456789");
    for (size_t i = 0; *file == '.' && i < sizeof extensions / sizeof *extensions; i++)
        if (strcmp(file + 1, extensions[i]) == 0)
            return 1;
    return 0;
}

static int is_used(const char *folder, const char *base)
{
    DIR *files = opendir(folder);
    const struct dirent *entry;
    int used = 0;

    while (files && !used && (entry = readdir(files)))
        used = belongs_to(entry->d_name, base);
    if (files)
        closedir(files);
    return used;
}

/* The number of the base name to take; CANDIDATES_MAX: none. */
static int choose(const struct claims *c, struct buffer *base)
{
    for (int i = 0; i < CANDIDATES_MAX; i++) {
        candidate(c, i, base);
        if (is_ours(c, buffer_text(base)))
            return i;
    }
    for (int i = 0; i < CANDIDATES_MAX; i++) {
        candidate(c, i, base);
        if (!is_used(c->folder, buffer_text(base)))
            return i;
    }
    return CANDIDATES_MAX;
}

/* Choose the base name, and add the claim to the file if it is new. */
static status keep(struct claims *c, const char *path, int force, struct buffer *base, struct error *err)
{
    int number = force ? 0 : choose(c, base);

    candidate(c, number, base);
    must_(buffer_ok(base) && buffer_ok(&c->text) && buffer_ok(&c->name));
    if (number == CANDIDATES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%s: %s and %d names with this job's number are other jobs' files; choose "
                         "another folder with -o",
                         c->folder, buffer_text(&c->name), CANDIDATES_MAX - 1);
    if (number > 0)
        fprintf(stderr,
                "%s: the files named %s are not this job's; its own are named %s (--force "
                "overwrites)\n",
                c->folder, buffer_text(&c->name), buffer_text(base));
    if (is_ours(c, buffer_text(base)))
        return STATUS_OK;
    if (c->text.size == 0)
        buffer_puts(&c->text, "# the jobs from which the files of this folder were fetched: job, time "
                              "of submission, scene, name\n");
    buffer_printf(&c->text, "%s%s\n", c->owner, buffer_text(base));
    must_hold(&c->text);
    return file_write_atomic(path, c->text.data, c->text.size, err);
}

/* If folders cannot be locked (NFS), two simultaneous fetches may choose the same name. */
static void lock_folder(struct claim *claim, const char *folder)
{
    claim->lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    claim->locked = claim->lock >= 0;
    if (claim->locked && flock(claim->lock, LOCK_EX) != 0)
        claim_unlock(claim);
}

void claim_unlock(struct claim *claim)
{
    if (claim->locked)
        close(claim->lock);
    claim->locked = 0;
}

void claim_release(struct claim *claim)
{
    claim_unlock(claim);
    buffer_release(&claim->base);
}

static status claims_read(struct claims *c, const char *path, const Azulejo__Wire__JobInfo *job, struct error *err)
{
    char hex[DIGEST_HEX_SIZE] = "-";
    status result = STATUS_OK;

    if (job->scene.len == DIGEST_BYTES) {
        struct digest digest;
        memcpy(digest.bytes, job->scene.data, DIGEST_BYTES);
        digest_to_hex(&digest, hex);
    }
    snprintf(c->owner, sizeof c->owner, "%" PRIu64 " %" PRId64 " %s ", job->job, job->submitted_at, hex);
    claim_plain_name(job, &c->name);
    if (file_exists(path))
        result = file_read(path, CLAIMS_BYTES_MAX, &c->text, err);
    if (result == STATUS_OK && c->text.size > 0 && c->text.data[c->text.size - 1] != '\n')
        buffer_puts(&c->text, "\n");
    return result;
}

static void claims_release(struct claims *c)
{
    buffer_release(&c->name);
    buffer_release(&c->text);
}

status claim_find(const char *folder, const Azulejo__Wire__JobInfo *job, struct buffer *base, struct error *err)
{
    struct claims c = {.folder = folder, .text = BUFFER_INIT, .name = BUFFER_INIT, .job = job->job};
    char *path = must(file_join(folder, CLAIMS_FILE));
    status result = claims_read(&c, path, job, err);
    int found = 0;

    for (int i = 0; result == STATUS_OK && !found && i < CANDIDATES_MAX; i++) {
        candidate(&c, i, base);
        found = is_ours(&c, buffer_text(base));
    }
    if (!found)
        buffer_clear(base);
    claims_release(&c);
    mem_free(path);
    return result;
}

status claim_take(struct claim *claim, const char *folder, const Azulejo__Wire__JobInfo *job, int force,
                  struct error *err)
{
    struct claims c = {.folder = folder, .text = BUFFER_INIT, .name = BUFFER_INIT, .job = job->job};
    char *path = must(file_join(folder, CLAIMS_FILE));
    status result;

    lock_folder(claim, folder);
    result = claims_read(&c, path, job, err);
    THEN(result, keep(&c, path, force, &claim->base, err));
    claims_release(&c);
    mem_free(path);
    return result;
}
