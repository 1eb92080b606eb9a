/* study_data: the results of `azulejo accuracy` for a scene, before anything is drawn.
 *
 * The runner fills a struct study, study_write stores it as JSON after each step, study_read reads an interrupted
 * study, and the page, the plots, the table and the terminal's lines are functions of it alone. Text is owned UTF-8
 * (NULL: none), an unknown number is NaN. study_init makes an empty study, study_release frees it.
 *
 * Units: core_s is processor time in seconds, wall_s time on the clock, codes are steps of an 8-bit screen (of 255):
 * the display error of docs/ARCHITECTURE.md.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

/* A growable list; study_add_* append. */
#define STUDY_LIST(type)        \
    struct {                    \
        type *items;            \
        size_t count, capacity; \
    }

/* A figure with its 95 % interval. */
struct study_interval {
    double value, low, high;
};

/* One measured picture. */
struct study_point {
    double core_s, wall_s, samples /* of a pixel, mean */, rays;
    struct study_interval codes;
    double psnr_db;
    struct study_interval rmse; /* over the frame's mean: 0.01 is 1 % */
    /* Against the study's reference: the mean of the seeds' pictures, the best and the worst of them. */
    struct study_interval relmse, flip;
    struct study_interval seeds; /* the error in codes that each seed's picture has by its own samples: mean, least, most */
    int reliable;               /* 0: the error may be understated (common/accuracy/word.h) */
    double top_share;           /* of the squared error, in the 0.1 % of the pixels with most of it */
    char *reason;               /* why it may be understated, and the likely cause; or NULL */
};
typedef STUDY_LIST(struct study_point) study_points;

/* The law of prices (common/accuracy/price.h) from the last point on: it goes through codes_at_pivot, and falls with the
 * exponent there, both over the time since start_core_s. The two are taken to be independent. */
struct study_fit {
    struct study_interval exponent;
    double pivot_core_s;
    double start_core_s; /* what a picture costs before its first ray; NaN: none */
    struct study_interval codes_at_pivot;
};

/* 8-bit RGB, row 0 on top. */
struct study_picture {
    uint32_t width, height;
    uint8_t *rgb;
};

/* One region at growing cost. */
struct study_crop {
    double core_s, codes;
    struct study_picture picture;
};
struct study_region {
    char *label; /* "typical", "worst" */
    double x, y; /* upper left corner in the frame, pixels */
    STUDY_LIST(struct study_crop) crops;
};

/* One way of rendering beside the usual one. */
struct study_choice {
    char *name;    /* at the end of its curve: "uniform" */
    char *words;   /* the start of its sentence: "Environment sampled uniformly" */
    char *note;    /* the end of it: "too dark in the corner", or NULL */
    int baseline;  /* this is what the main curve does */
    int unbiased;  /* by construction it is the usual picture except for its noise */
    int missed;    /* it is, but its samples have certainly missed some light: its error is larger
                      */
    int by_target; /* this is how a render with a target error distributes its samples */
    double taken;  /* share of the picture's light that it takes away */
    study_points points;
    double gain_at;              /* codes at which gain holds */
    struct study_interval gain;  /* the baseline's core seconds over its own: 2 is half the time */
    struct study_interval floor; /* its bias in codes, which no number of samples removes */
};
struct study_question {
    char *title; /* "Environment sampling" */
    STUDY_LIST(struct study_choice) choices;
};

struct study_effect {
    char *name;
    struct study_interval saved; /* share of the time that leaving it out saves */
    struct study_interval bias;  /* codes that leaving it out changes */
};

struct study_worker {
    char *name;
    double cores;
};

/* Numbers of tiles, row by row from the top. */
struct study_map {
    double columns, rows;
    STUDY_LIST(double) values;
};

struct study_bin {
    double low, high, count;
};

/* How few pixels hold how much of the squared error: the `pixels[i]` of them (a share, rising) with most of
 * it hold `error[i]`. */
struct study_tail {
    STUDY_LIST(double) pixels;
    STUDY_LIST(double) error;
    double index; /* Pareto k of the largest contributions of single samples */
};

/* A round's prediction, and the actual result. */
struct study_prediction {
    double round, core_s_then, target_codes;
    struct study_interval core_s;
    double core_s_true; /* NaN: not reached yet */
};

struct study {
    char *scene, *machine, *date, *command, *version, *transform;
    char *reference;    /* the picture that relmse and flip are against; NULL: none */
    double clock_noise; /* standard deviation of ln of one picture's time */
    double width, height, cores /* of all workers */, seed, traversal_share /* of the time, Embree's */;
    double target_codes;
    struct study_interval target_core_s; /* predicted or met */
    double price_core_hour;              /* NaN: not given */
    char *currency;
    double deadline_s;   /* from now, NaN: not given */
    char *deadline;      /* "18:00" */
    int complete;        /* 0: the study was interrupted */
    study_points points; /* by growing core_s */
    struct study_fit fit;
    STUDY_LIST(struct study_region) regions;
    STUDY_LIST(struct study_question) questions;
    STUDY_LIST(struct study_effect) effects;
    STUDY_LIST(struct study_worker) workers;
    struct study_map tile_error, tile_samples; /* codes; samples of a pixel */
    STUDY_LIST(struct study_bin) histogram;    /* pixels by error in codes */
    struct study_tail tail;
    STUDY_LIST(struct study_prediction) predictions;
};

enum {
    STUDY_LIST_MAX = 4096,      /* entries of a list of structures */
    STUDY_NUMBERS_MAX = 1 << 18, /* tiles of a map, contributions of a tail */
    STUDY_TEXT_MAX = 4096,      /* bytes */
    STUDY_PICTURE_SIDE_MAX = 1024,
    STUDY_FILE_BYTES_MAX = 256 << 20,
};

/* Every number NaN, every list empty. */
void study_init(struct study *s);
void study_release(struct study *s);

/* Append an element with its numbers NaN. A full list (STUDY_LIST_MAX) ends the program as exhausted memory does. The
 * pointer is good until the next element is added.  struct study_point *p = study_add_point(&s->points); */
struct study_point *study_add_point(study_points *points);
struct study_region *study_add_region(struct study *s);
struct study_crop *study_add_crop(struct study_region *region);
struct study_question *study_add_question(struct study *s);
struct study_choice *study_add_choice(struct study_question *question);
struct study_effect *study_add_effect(struct study *s);
struct study_worker *study_add_worker(struct study *s);
struct study_bin *study_add_bin(struct study *s);
struct study_prediction *study_add_prediction(struct study *s);

/* Replace a text. */
void study_text_set(char **text, const char *value);

/* Append the study as JSON, or fill an initialised one from JSON; `name` is for messages. Reading
 * what was written gives the same study. ERR_INPUT names the field; ERR_LIMIT. */
status study_write(struct buffer *out, const struct study *s, struct error *err) MUST_CHECK;
status study_read(struct study *s, const char *json, size_t size_bytes, const char *name, struct error *err) MUST_CHECK;

/* Append `size_bytes` as base64, without line breaks. */
void study_base64(struct buffer *out, const void *data, size_t size_bytes);
/* Append the picture as a PNG file, every pixel as it is. */
status study_picture_png(struct buffer *out, const struct study_picture *picture, struct error *err) MUST_CHECK;
