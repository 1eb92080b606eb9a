/* The display pictures of a stored frame again. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/system/log.h"
#include "coordinator/job/wire.h"

#define STATE_EXTENSION "state"

/* A state in a file: the digest of the settings that it was measured with and of the picture, then its bytes in this
 * machine's byte order. If the file holds anything else, the state is measured again. */
struct stored_state {
    struct digest of;
    struct tonemap_state state;
};

/* 0: not known. */
static int find_of(const struct development *d, const struct store *store, uint32_t frame, const struct digest *looks,
                   struct digest *out)
{
    struct digest both[2] = {*looks};

    return development_picture_digest(d, store, frame, &both[1]) && digest_of(out, both, sizeof both) == STATUS_OK;
}

/* The state of this or another frame: read from the store, or else measured and stored. */
static status state_of(const struct development *d, const struct toning *t, struct store *store, uint32_t frame,
                       const struct digest *looks, struct tonemap_state *out, struct error *err)
{
    struct buffer file = BUFFER_INIT;
    struct image other = {0}, straight = {0};
    struct stored_state stored;
    struct digest of = {0};
    float *alpha = NULL;
    const int known = find_of(d, store, frame, looks, &of);
    status s;

    if (known && store_output_read(store, d->job, frame, STATE_EXTENSION, sizeof stored, &file, NULL) == STATUS_OK &&
        file.size == sizeof stored) {
        memcpy(&stored, file.data, sizeof stored);
        if (digest_equal(&stored.of, &of)) {
            *out = stored.state;
            buffer_release(&file);
            return STATUS_OK;
        }
    }
    buffer_clear(&file);
    s = frame == d->frame ? STATUS_OK : development_read_picture(d, store, frame, &other, &alpha, err);
    memset(&stored, 0, sizeof stored);
    if (s == STATUS_OK && d->alpha)
        s = develop_straight(&straight, frame == d->frame ? &d->image : &other, frame == d->frame ? d->alpha : alpha,
                             err);
    THEN(s, tonemap_measure(&stored.state,
                            d->alpha            ? &straight
                            : frame == d->frame ? &d->image
                                                : &other,
                            t->settings, &t->context, err));
    if (s == STATUS_OK)
        *out = stored.state;
    if (s == STATUS_OK && known) {
        stored.of = of;
        buffer_append(&file, &stored, sizeof stored);
        /* Without it the next frame measures again. */
        if (!buffer_ok(&file) || store_output_write(store, d->job, frame, STATE_EXTENSION, &file, NULL) != STATUS_OK)
            log_debug("job %" PRIu64 ", frame %u: its statistics were not kept", d->job, frame);
    }
    image_release(&straight);
    image_release(&other);
    mem_free(alpha);
    buffer_release(&file);
    return s;
}

/* The mean state of the frames from window_begin to the development's own. */
static status window_state(const struct development *d, const struct toning *t, struct store *store,
                           struct tonemap_state *out, struct error *err)
{
    uint32_t count = d->frame - d->window_begin + 1;
    struct tonemap_state *states = mem_alloc_array(count, sizeof *states);
    const struct tonemap_state **pointers = mem_alloc_array(count, sizeof *pointers);
    struct digest looks;
    status s =
        states && pointers ? wire_output_digest(&looks, &d->output, err) : error_no_memory(err, "frames' statistics");

    for (uint32_t i = 0; i < count && s == STATUS_OK; i++) {
        pointers[i] = &states[i];
        s = state_of(d, t, store, d->window_begin + i, &looks, &states[i], err);
    }
    if (s == STATUS_OK)
        tonemap_state_mean(out, pointers, count, &d->output.tonemap);
    mem_free(pointers);
    mem_free(states);
    return s;
}

status develop_again(struct development *d, struct store *store, struct error *err)
{
    struct tonemap_state *state = mem_alloc(sizeof *state);
    struct toning t;
    status s = state ? STATUS_OK : error_no_memory(err, "a frame's statistics");

    THEN(s, development_read_picture(d, store, d->frame, &d->image, &d->alpha, err));
    THEN(s, development_denoise(d, store, err));
    if (s == STATUS_OK && d->denoised_known) { /* it was made now */
        if (d->output.exr && tonemap_around(&d->output.tonemap) > 0)
            s = development_renew_layer(d, store, err);
        THEN(s, development_write_denoised(d, store, err)); /* last: what is kept is not made again after a crash */
        THEN(s, store_history_denoised(store, d->job, d->frame, &d->point.denoised, err));
    }
    THEN(s, toning_begin(&t, d, store, err));
    if (s == STATUS_OK) {
        if (d->output.tonemap.temporal > 1) {
            s = window_state(d, &t, store, state, err);
            t.context.state = state;
        }
        THEN(s, develop_write_display(d, &t, store, err));
        toning_end(&t);
    }
    THEN(s, store_frame_developed(store, d->job, d->frame, d->revision, err));
    mem_free(state);
    return s;
}
