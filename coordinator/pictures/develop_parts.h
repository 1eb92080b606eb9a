/* develop_parts: the inside of a development, shared by the files develop*.c; private to them.
 *
 * develop.c makes and ends one, develop_exr.c the EXR file, develop_display.c what a display shows, develop_again.c that of
 * stored frames (develop_stored.c), develop_figures.c how wrong it is, develop_denoise.c the picture without its noise,
 * develop_matte.c its layers for Cryptomatte, develop_manifest.c what a frame called for. */
#pragma once

#include "common/image/image.h"
#include "common/scene/scene.h"
#include "coordinator/pictures/cryptomatte.h"
#include "coordinator/pictures/develop.h"
#include "coordinator/pictures/measure.h"

enum {
    DEVELOPMENT_MATTES = 3, /* kinds of Cryptomatte layers */
    DEVELOPMENT_MATTE_ATTRIBUTES = 4 * DEVELOPMENT_MATTES,
};

struct development {
    uint64_t job;
    uint64_t epoch_floor; /* of the job: another one means other rules */
    char name[JOB_NAME_MAX + 1], scene_name[JOB_NAME_MAX + 1], ray_tracer[RAY_TRACER_NAME_MAX + 1];
    char source[JOB_SOURCE_MAX + 1];
    struct stop_rules stop;
    struct digest scene;
    int64_t submitted_at;
    uint32_t frame, first_frame, window_begin;
    uint32_t around[JOB_AROUND_MAX], around_count; /* job_frames_around */
    uint32_t revision;                             /* of `output` */
    struct render_settings settings;
    struct output_settings output;
    struct film_coverage coverage;
    enum frame_end end;         /* FRAME_END_NONE: a preview */
    struct history history;     /* before this development */
    struct history_point point; /* its figures, and the time spent by then */
    uint32_t place;             /* of `point` in the history, once it is `placed` there */
    int placed;
    int image_ends; /* the display picture is the last that is made of `image`, which is then freed */
    int measured;   /* `point` belongs to this development; else it is the newest one, if
                                any */
    struct frame_evidence evidence;
    struct measurement measurement; /* copied, if `film` is NULL */
    float *tile_errors;             /* [tiles] display codes, for AOV_ERROR; NULL: not wanted, or not known */
    struct unit_work work;
    struct work_stats stats;
    uint32_t audited;       /* as in struct job_frame */
    struct buffer schedule; /* text (common/accuracy/schedule.h); empty: the rules alone reproduce
                                the picture */
    int is_preview;
    const struct film *film; /* NULL: `image` holds a copy, and there are no AOVs */
    uint32_t next_tile;      /* to copy (development_take) */
    int taken;               /* `image` holds the film's means */
    struct image image;
    int is_look;              /* for one who looks: nothing is kept of it */
    struct image denoised;    /* the same without its noise; empty: not asked for, or not made yet */
    int denoised_before;      /* it was made when frames around had other samples, and cannot be made again */
    int denoised_known;       /* the next four are of it, and in the header */
    int denoised_guided;      /* by albedo and normal */
    uint32_t denoised_frames; /* this one, and those around it */
    enum denoise_method denoise_method;
    struct denoise_counts denoise_counts;
    float *alpha;          /* [pixels], for AOV_ALPHA, by which the image is multiplied; else NULL */
    uint8_t *there;        /* of a preview: which tiles have samples; the others are to be filled; NULL: nothing
                                to fill */
    int looked, described; /* `description` was read; it is the job's scene */
    struct scene description;
    struct cryptomatte mattes[DEVELOPMENT_MATTES]; /* of those that are asked for */
};

/* Tone mapping of one development: its settings, and the operator's file. */
struct toning {
    const struct tonemap_settings *settings;
    struct tonemap_context context;
    struct buffer file;
};

/* Read the job's scene, once. A damaged scene does not prevent the picture: only its header and its
 * manifest say less. A failure of the environment is an error. */
status development_describe(struct development *d, const struct store *store, struct error *err);
/* The effects that the frame needs by its description: the same on every farm, and after a restart. */
uint64_t development_effects(const struct development *d);
/* The command that renders the frame again, in the folder of its scene. */
void develop_command(const struct development *d, struct buffer *out);
double development_mean_samples(const struct development *d); /* of a pixel */
double development_covered(const struct development *d);      /* the share of its tiles that have samples */
int development_is_full(const struct development *d);         /* every pixel has all samples */
int development_is_whole(const struct development *d);        /* it ended by its rules, not by a limit or a
                                                          cancel */

status develop_exr(struct development *d, struct buffer *exr, struct error *err);

/* ---- develop_view.c: the camera where the shutter opens ---- */
struct development_view {
    int has_camera, has_ndc;         /* none without the scene; no NDC of a panorama */
    float to_camera[16], to_ndc[16]; /* as m44f attributes: vectors are rows */
    int32_t rate[2];                 /* frames a second, a fraction */
};
status development_find_view(const struct development *d, struct development_view *view, struct error *err);

/* ---- develop_matte.c: Cryptomatte layers of a film, if they are asked for ---- */
/* Under the names of the description, which was looked for. */
status development_mattes_begin(struct development *d, struct error *err);
void development_mattes_end(struct development *d);
/* How many channels they have, after those of other variables. */
size_t development_mattes_channels(const struct development *d, struct exr_channel *out);
/* The header's part: points to `names`, and into `d`. */
size_t development_mattes_attributes(const struct development *d, struct exr_attribute *out,
                                     char names[DEVELOPMENT_MATTE_ATTRIBUTES][CRYPTOMATTE_NAME_SIZE]);
/* Samples that are missing in them. */
uint64_t development_mattes_lost(const struct development *d);
/* As exr_channels.lines; returns the end of what was written. */
float *development_mattes_lines(const struct development *d, uint32_t y, uint32_t height, float *planes);

status toning_begin(struct toning *t, const struct development *d, const struct store *store, struct error *err);
void toning_end(struct toning *t);
/* A new picture of the colours themselves, not multiplied by alpha. */
status develop_straight(struct image *out, const struct image *image, const float *alpha, struct error *err);
/* The same picture with alpha as its fourth channel. */
status develop_with_alpha(struct image *out, const struct image *image, const float *alpha, struct error *err);
/* Append the picture as PNG or JPEG, either of which may be NULL. */
status develop_encode_display(struct development *d, const struct toning *t, struct buffer *png, struct buffer *jpg,
                              struct error *err);
status develop_write_display(struct development *d, const struct toning *t, struct store *store, struct error *err);
/* The means in 32 bits are kept, so that the frame can be developed again. */
int development_picture_is_apart(const struct development *d);
status development_write_picture(const struct development *d, struct store *store, struct error *err);

/* A frame's stored picture, and the alpha of one that has it. ERR_NOT_FOUND: it was removed. */
status development_read_picture(const struct development *d, const struct store *store, uint32_t frame,
                                struct image *out, float **alpha, struct error *err);
/* The digest of that file. 0: not known. */
int development_picture_digest(const struct development *d, const struct store *store, uint32_t frame, struct digest *out);
/* Take that of the development's own frame. */
status develop_take_stored(struct development *d, const struct store *store, struct error *err);

/* What the pictures of a display are made of. */
static inline const struct image *development_shown(const struct development *d)
{
    return d->denoised.pixels ? &d->denoised : &d->image;
}
/* ---- develop_denoise.c ---- */
/* Make d->denoised of the film, of the copy of one in d->measurement (at once and without figures), or of a stored
 * frame: that what was kept, else it is made of the frame's kept film. Nothing happens if it is not asked for.
 * ERR_NOT_FOUND: a stored frame's film was not kept. */
status development_denoise(struct development *d, const struct store *store, struct error *err);
/* Keep it, so that it need not be made again. */
status development_write_denoised(const struct development *d, struct store *store, struct error *err);
/* The same as the layer of the frame's EXR, if that has one. */
status development_renew_layer(const struct development *d, struct store *store, struct error *err);
/* "albedo, normal, emission"; "none": by its colours alone. */
const char *development_guides_text(const struct development *d);
const char *denoise_method_name(enum denoise_method method);

/* The radiance of the brightest light that a path may meet by chance; 0: not known. */
double development_brightest(const struct development *d);
/* The figures of error, into d->point, and the tiles' errors if the AOV wants them. */
status development_find_figures(struct development *d, const struct store *store, struct error *err);
