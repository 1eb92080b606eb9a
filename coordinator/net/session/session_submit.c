/* A job as a client submits it: its scene, blobs and files must be in the store. */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/scene/scene.h"
#include "coordinator/job/wire.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_may.h"
#include "coordinator/net/session/session_messages.h"
#include "coordinator/net/session/session_tasks.h"
#include "protocol/message.h"

enum { MISSING_NAMED_MAX = 4 }; /* digests named in a failure */

/* Are all blobs of the scene in the store, with the sizes in its description? */
static status check_blobs(struct session *session, const struct scene *scene, struct error *err)
{
    struct scene_blob *blobs = NULL;
    char named[MISSING_NAMED_MAX * 20] = "";
    size_t count = 0, missing = 0;
    status s = scene_blobs(scene, &blobs, &count, err);

    for (size_t i = 0; s == STATUS_OK && i < count; i++) {
        char hex[DIGEST_HEX_SIZE];
        uint64_t size;
        int found = session_blob_hold(session, &blobs[i].digest, &size);
        if (found < 0) {
            s = error_set(err, STATUS_ERR_IO, "the coordinator cannot look for the scene's blobs: %s", strerror(errno));
            continue;
        }
        if (found) {
            if (size != blobs[i].size_bytes)
                s = error_set(err, STATUS_ERR_INPUT,
                              "the scene says that a blob has %" PRIu64 " bytes, but it has %" PRIu64,
                              blobs[i].size_bytes, size);
            continue;
        }
        digest_to_hex(&blobs[i].digest, hex);
        if (missing++ < MISSING_NAMED_MAX)
            snprintf(named + strlen(named), sizeof named - strlen(named), " %.12s", hex);
    }
    if (s == STATUS_OK && missing > 0)
        s = error_set(err, STATUS_ERR_NOT_FOUND,
                      "%zu of the scene's %zu blobs are not on the coordinator:%s%s; send them first", missing, count,
                      named, missing > MISSING_NAMED_MAX ? " ..." : "");
    mem_free(blobs);
    return s;
}

status session_check_tonemap(struct session *session, const struct output_settings *output, struct error *err)
{
    uint64_t size;

    if (!output->tonemap.has_file || session_blob_hold(session, &output->tonemap.file, &size))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "the file %s of the tone mapping is not on the coordinator; send it first",
                     output->tonemap.file_name);
}

/* What the job needs: its scene, the scene's blobs, and the tone mapping's file. */
static status list_blobs(const struct scene *scene, const struct job *job, struct digest **out, size_t *out_count,
                         struct error *err)
{
    struct scene_blob *blobs = NULL;
    size_t count = 0;

    TRY(scene_blobs(scene, &blobs, &count, err));
    *out = mem_alloc_array(count + 2, sizeof **out);
    for (size_t i = 0; *out && i < count; i++)
        (*out)[i] = blobs[i].digest;
    mem_free(blobs);
    NEED(*out, err, "a list of blobs");
    (*out)[count++] = job->scene;
    if (job->output.tonemap.has_file)
        (*out)[count++] = job->output.tonemap.file;
    *out_count = count;
    return STATUS_OK;
}

static status make_job(struct session *session, const Azulejo__Wire__JobSubmit *message, struct job **out,
                       struct digest **blobs, size_t *blob_count, struct error *err)
{
    const char *folder = store_folder(session->server->store);
    struct buffer packed = BUFFER_INIT;
    struct digest digest;
    struct scene scene;
    uint64_t size;
    status s = wire_digest_get(&digest, &message->scene, "the scene", err);

    scene_init(&scene);
    THEN(s, session_may_submit(session, message->owner, message->priority, err));
    if (s == STATUS_OK) {
        (void)session_blob_hold(session, &digest, &size);
        s = blobs_read(folder, &digest, SCENE_BYTES_MAX, &packed, err);
        if (s != STATUS_OK)
            error_prefix(err, "the scene");
    }
    THEN(s, scene_unpack(&scene, packed.data, packed.size, err));
    THEN(s, check_blobs(session, &scene, err));
    THEN(s, wire_job_get(out, message, scene.camera_count, err));
    if (s == STATUS_OK) { /* from here on it is the job's own, and is never changed */
        struct render_settings *settings = &(*out)->settings;
        if ((*out)->output.tonemap.denoise != DENOISING_OFF)
            settings->aovs |= AOV_FOR_DENOISING;
        if (tonemap_around(&(*out)->output.tonemap) > 0)
            settings->aovs |= 1u << AOV_POSITION | 1u << AOV_OBJECT_ID; /* by which frames are matched where something moves */
        settings->aovs = aovs_with_implied(settings->aovs);
    }
    if (s == STATUS_OK && !(*out)->needs.memory_said)
        (*out)->needs.memory = need_of_scene(&scene, packed.size);
    if (s == STATUS_OK) {
        s = session_check_tonemap(session, &(*out)->output, err);
        THEN(s, list_blobs(&scene, *out, blobs, blob_count, err));
        if (s != STATUS_OK) {
            job_free(*out);
            *out = NULL;
        }
    }
    if (s == STATUS_OK) {
        if (!(*out)->owner[0])
            snprintf((*out)->owner, sizeof(*out)->owner, "%s", session->who);
        message_text((*out)->scene_name, sizeof(*out)->scene_name, scene.name ? scene.name : "");
        if (!(*out)->name[0])
            snprintf((*out)->name, sizeof(*out)->name, "%s", (*out)->scene_name);
    }
    scene_release(&scene);
    buffer_release(&packed);
    return s;
}
status session_submit(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                      struct error *err)
{
    struct job *job = NULL;
    struct digest *blobs = NULL;
    size_t blob_count = 0;
    status s = make_job(session, message->job_submit, &job, &blobs, &blob_count, err);

    if (s == STATUS_OK)
        session_task_submit(session, message->request, job, blobs, blob_count, message->job_submit->force);
    else
        log_info("a job from %s was refused: %s", session->host, err->text);
    return s;
}
