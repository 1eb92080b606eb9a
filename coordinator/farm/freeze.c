#include "coordinator/farm/freeze.h"

#include <inttypes.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/tonemap/tonemap.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/job/wire.h"

/* ---- the note ------------------------------------------------------------------------------- */

/* A note: settings and the state measured with them. Its form in a film's file: the settings' length (32 bits), the
 * settings in their wire form, then the state's numbers as doubles, all little-endian. */
struct note {
    struct tonemap_settings settings;
    struct tonemap_state state;
};

enum { STATE_FIXED = 5 };

static void append_double(struct buffer *out, double value)
{
    uint8_t bytes[8];
    uint64_t bits;

    memcpy(&bits, &value, sizeof bits);
    for (int i = 0; i < 8; i++)
        bytes[i] = (uint8_t)(bits >> 8 * i);
    buffer_append(out, bytes, sizeof bytes);
}

static double get_double(const uint8_t *in)
{
    uint64_t bits = 0;
    double value;

    for (int i = 7; i >= 0; i--)
        bits = bits << 8 | in[i];
    memcpy(&value, &bits, sizeof value);
    return value;
}

static status note_pack(const struct note *note, struct buffer *out, struct error *err)
{
    const struct tonemap_state *s = &note->state;
    uint8_t *length = buffer_append_space(out, 4);
    status st = length ? wire_tonemap_pack(&note->settings, out, err) : error_no_memory(err, "a frame's statistics");
    size_t size = out->size - 4;

    if (st != STATUS_OK)
        return st;
    for (int i = 0; i < 4; i++)
        out->data[i] = (uint8_t)(size >> 8 * i);
    append_double(out, s->counts);
    append_double(out, s->metered_ev);
    append_double(out, s->ln_log_mean);
    append_double(out, s->ln_max);
    append_double(out, s->ln_min);
    for (size_t i = 0; i < note->settings.op->state_count; i++)
        append_double(out, s->values[i]);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a frame's statistics");
}

/* ERR_CORRUPT if the bytes are not a note of this release. */
static status note_unpack(struct note *note, const struct buffer *in, struct error *err)
{
    const uint8_t *at = in->data;
    size_t settings = 0, numbers;

    for (int i = 3; i >= 0 && in->size >= 4; i--)
        settings = settings << 8 | at[i];
    if (in->size < 4 || settings > in->size - 4)
        return error_set(err, STATUS_ERR_CORRUPT, "it is too short");
    TRY(wire_tonemap_unpack(&note->settings, at + 4, settings, err));
    numbers = STATE_FIXED + note->settings.op->state_count;
    if (in->size - 4 - settings != numbers * 8 || tonemap_reach(&note->settings) == TONEMAP_REACH_PICTURE)
        return error_set(err, STATUS_ERR_CORRUPT, "it has %zu bytes", in->size);
    at += 4 + settings;
    note->state = (struct tonemap_state){
        .counts = get_double(at) != 0, .metered_ev = get_double(at + 8),
        .ln_log_mean = get_double(at + 16), .ln_max = get_double(at + 24),
        .ln_min = get_double(at + 32)};
    for (size_t i = 0; i < note->settings.op->state_count; i++)
        note->state.values[i] = get_double(at + (STATE_FIXED + i) * 8);
    return STATUS_OK;
}

/* The group's note on disk. *found 0: there is no usable one. */
static status note_read(struct note *note, const struct job_frame *frame, uint32_t group, int *found, struct error *err)
{
    struct buffer bytes = BUFFER_INIT;
    struct error why = {0};
    status s = STATUS_OK;

    *found = 0;
    if (frame->file)
        s = film_file_note_read(frame->file, group, &bytes, err);
    if (s == STATUS_OK && bytes.size > 0) {
        *found = note_unpack(note, &bytes, &why) == STATUS_OK;
        if (!*found)
            log_warn("job %" PRIu64 ", frame %u: its display's measurement cannot be read (%s); it is measured again", frame->job->id, frame->number, why.text);
    }
    buffer_release(&bytes);
    return s;
}

static status note_write(const struct note *note, struct job_frame *frame, uint32_t group, struct error *err)
{
    struct buffer bytes = BUFFER_INIT;
    status s = STATUS_OK;

    if (!frame->file)
        return STATUS_OK;
    s = note_pack(note, &bytes, err);
    THEN(s, film_file_note_write(frame->file, group, &bytes, err));
    buffer_release(&bytes);
    return s;
}

/* The job's settings; if one group is frozen already, the settings used for it. */
static void frame_settings(struct tonemap_settings *out, const struct job_frame *frame)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        if (!frame->display[g])
            continue;
        *out = *tonemap_pixels_settings(frame->display[g]);
        return;
    }
    tonemap_stand_in(out, &frame->job->output.tonemap);
}

static void show(void *user, const float *rgb, uint32_t count, float *codes)
{
    tonemap_pixels_codes(user, rgb, count, codes);
}

/* The frame takes the pixels. */
static void freeze_group(struct job_frame *frame, uint32_t group, struct tonemap_pixels *pixels)
{
    frame->display[group] = pixels;
    film_freeze(frame->film, group, &(struct film_codes){show, pixels});
}

/* ---- when the film is opened ---------------------------------------------------------------- */

status freeze_open(struct job_frame *frame, struct error *err)
{
    struct note *note = mem_alloc(sizeof *note);
    status s = note ? STATUS_OK : error_no_memory(err, "a frame's statistics");

    for (uint32_t g = 0; g < GROUPS && s == STATUS_OK; g++) {
        struct tonemap_pixels *pixels;
        int found;

        s = note_read(note, frame, g, &found, err);
        if (s == STATUS_OK && !found) {
            frame_settings(&note->settings, frame);
            memset(&note->state, 0, sizeof note->state);
        }
        if (s != STATUS_OK || note->settings.has_file ||
            (!found && tonemap_reach(&note->settings) != TONEMAP_REACH_PIXEL))
            continue; /* in another thread, when level 0 is there */
        /* Not synced: until later samples are synced, it can be measured again. */
        if (!found)
            s = note_write(note, frame, g, err);
        THEN(s, tonemap_pixels_new(&pixels, &note->settings, &note->state, NULL, err));
        if (s == STATUS_OK)
            freeze_group(frame, g, pixels);
    }
    mem_free(note);
    return s;
}

status freeze_was_measured(const struct job_frame *frame, int *measured, struct error *err)
{
    struct note *note = mem_alloc(sizeof *note);
    status s = note ? STATUS_OK : error_no_memory(err, "a frame's statistics");

    *measured = 0;
    for (uint32_t g = 0; g < GROUPS && s == STATUS_OK; g++) {
        int found;
        s = note_read(note, frame, g, &found, err);
        *measured |= s == STATUS_OK && found && tonemap_reach(&note->settings) != TONEMAP_REACH_PIXEL;
    }
    mem_free(note);
    return s;
}

/* ---- measuring ------------------------------------------------------------------------------ */

struct freezing {
    struct job_frame *frame;
    uint32_t group;
    const struct store *store; /* NULL: none */
    struct note note;          /* the settings to measure with, until it is run */
    struct image image;        /* of the group's level 0 */
    int smooth;                /* it is there, smoothed */
    struct tonemap_pixels *pixels;
    status result;
    struct error error;
};

const struct job_frame *freezing_frame(const struct freezing *f) { return f->frame; }

static void freezing_free(struct freezing *f)
{
    image_release(&f->image);
    tonemap_pixels_free(f->pixels);
    mem_free(f);
}

static status freezing_new(struct freezing **out, const struct farm *farm, struct job_frame *frame, uint32_t group,
                           struct error *err)
{
    struct freezing *f = mem_calloc(1, sizeof *f);

    NEED(f, err, "a frame's statistics");
    f->frame = frame;
    f->group = group;
    f->store = farm->store;
    frame_settings(&f->note.settings, frame);
    *out = f;
    return STATUS_OK;
}

/* In any thread: the group stays as it is until film_freeze. */
static status take_image(struct freezing *f, struct error *err)
{
    const struct film *film = f->frame->film;
    status s;

    if (f->smooth)
        return STATUS_OK;
    image_release(&f->image);
    s = image_init(&f->image, film_width(film), film_height(film), 3, err);
    if (s == STATUS_OK)
        film_develop_group(film, f->group, f->image.pixels);
    THEN(s, image_smooth(&f->image, FREEZE_RADIUS, err));
    f->smooth = s == STATUS_OK;
    return s;
}

/* Measure, unless the note exists already, and make the transform from it. */
static status measure_with(struct freezing *f, int has_state, struct error *err)
{
    struct tonemap_context context = {0};
    struct buffer file = BUFFER_INIT;
    struct note *note = &f->note;
    status s = STATUS_OK;

    if (note->settings.has_file) {
        s = f->store ? blobs_read(store_folder(f->store), &note->settings.file, TONEMAP_FILE_BYTES_MAX, &file, err)
                     : error_set(err, STATUS_ERR_NOT_FOUND, "no store has the operator's file");
        context.file_data = file.data;
        context.file_size = file.size;
    }
    if (s == STATUS_OK && !has_state)
        s = take_image(f, err);
    if (s == STATUS_OK && !has_state)
        s = tonemap_measure(&note->state, &f->image, &note->settings, &context, err);
    tonemap_pixels_free(f->pixels); /* from an earlier attempt */
    f->pixels = NULL;
    THEN(s, tonemap_pixels_new(&f->pixels, &note->settings, &note->state, &context, err));
    buffer_release(&file);
    return s;
}

void freezing_run(struct freezing *f)
{
    struct tonemap_settings linear;
    struct error *err = &f->error;
    struct error why = {0};
    int found;
    status s = note_read(&f->note, f->frame, f->group, &found, err);

    THEN(s, measure_with(f, found, err));
    if (s != STATUS_OK && !status_is_environment(s) &&
        tonemap_settings_init(&linear, "linear", &why) == STATUS_OK) {
        /* Its pictures will fail with an error; its samples can still be distributed. */
        log_warn("job %" PRIu64 ", frame %u: errors are measured without its operator: %s",
                 f->frame->job->id, f->frame->number, err->text);
        linear.exposure_ev = f->note.settings.exposure_ev;
        linear.metering = f->note.settings.metering;
        linear.metering_percentile = f->note.settings.metering_percentile;
        f->note.settings = linear;
        found = 0;
        s = measure_with(f, found, err);
    }
    if (s == STATUS_OK && !found) {
        s = note_write(&f->note, f->frame, f->group, err);
        if (s == STATUS_OK && f->frame->file)
            s = film_file_sync(f->frame->file, err);
    }
    f->result = s;
}

void freezing_abandon(struct farm *farm, struct freezing *f)
{
    f->frame->freezing[f->group] = 0;
    farm_frame_unpin(farm, f->frame);
    freezing_free(f);
}

void freezing_end(struct farm *farm, struct freezing *f, uint64_t now_ns)
{
    struct job_frame *frame = f->frame;

    /* An ended frame keeps its samples: its pictures may already be being made. */
    if (frame->closing || frame->state != FRAME_RENDERING) {
        freezing_abandon(farm, f);
        return;
    }
    frame->freezing[f->group] = 0;
    farm_frame_unpin(farm, frame);
    if (f->result == STATUS_OK) {
        freeze_group(frame, f->group, f->pixels);
        f->pixels = NULL;
        farm_trouble_over(farm, frame->job, &frame->trouble, now_ns);
        job_frame_mark_folded(frame, now_ns);
        farm_wake(farm);
        farm_frame_advance(farm, frame, now_ns);
    } else {
        farm_trouble(farm, frame->job, frame->number, &frame->trouble, "cannot be measured", &f->error, now_ns);
    }
    freezing_free(f);
}

void freeze_step(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        struct error err = {0};
        struct freezing *f;
        status s;

        if (!film_wants_freeze(frame->film, g) || frame->freezing[g] || frame->closing ||
            frame->state != FRAME_RENDERING || !job_state_is_open(frame->job->state) || trouble_is(&farm->trouble) ||
            trouble_waits(&frame->trouble, now_ns))
            continue;
        s = freezing_new(&f, farm, frame, g, &err);
        if (s == STATUS_OK && farm->events.freeze) {
            s = farm->events.freeze(farm->events.user, f, &err);
            if (s != STATUS_OK)
                freezing_free(f);
        } else if (s == STATUS_OK) {
            freezing_run(f);
        }
        if (s != STATUS_OK) {
            farm_trouble(farm, frame->job, frame->number, &frame->trouble, "cannot be measured", &err, now_ns);
            continue;
        }
        frame->freezing[g] = 1;
        frame->in_flight++;
        if (!farm->events.freeze)
            freezing_end(farm, f, now_ns);
    }
}
