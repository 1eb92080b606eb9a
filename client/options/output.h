/* output: the pictures that a job makes, from the command line to the wire. */
#pragma once

#include "client/options/tonemap_options.h"
#include "protocol/output.h"

enum output_format {
    OUTPUT_FORMAT_EXR = 1,
    OUTPUT_FORMAT_PNG = 2,
    OUTPUT_FORMAT_JPEG = 4,
    OUTPUT_FORMAT_BOTH = 3,   /* EXR and PNG: the usual */
    OUTPUT_FORMAT_ALL = 7,
    OUTPUT_FORMAT_COUNT = 3,
};

struct output_options {
    struct tonemap_options tone;
    const char *formats; /* NULL: not given */
    const char *png_bits;
    int64_t jpeg_quality; /* 0: not given */
    int no_dither;
};

/* Rows for a command's table; `o` is a struct output_options. */
#define OUTPUT_OPTION_ROWS(o)                                                                   \
    TONEMAP_OPTION_ROWS((o).tone),                                                              \
    LOOK_ROW((o).tone, temporal), LOOK_ROW((o).tone, denoise_around),                        \
    {"format", 0, OPTION_STRING, &(o).formats, "FORMAT,...",                                    \
     "which pictures are made: exr, png and jpg", 0, 0, NULL},                                  \
    {"png-bits", 0, OPTION_CHOICE, &(o).png_bits, "N", "bits of a PNG's channel (default 8)", 0, 0, \
     "8|16"},                                                                                   \
    {"jpeg-quality", 0, OPTION_INT, &(o).jpeg_quality, "N",                                     \
     "quality of JPEG pictures, 1 to 100 (default 92)", 1, 100, NULL},                          \
    {"no-dither", 0, OPTION_FLAG, &(o).no_dither, NULL,                                         \
     "round the pictures' values instead of dithering them", 0, 0, NULL}

/* The options' values. The buffer belongs to the request. */
struct output_request {
    struct tonemap_settings tonemap;
    struct buffer tonemap_file;      /* the operator's file; empty without one */
    unsigned formats;                /* enum output_format; 0: not given */
    uint32_t png_bits, jpeg_quality; /* 0: nothing was said */
    int no_dither, half;
    double camera_ev; /* what of tonemap.exposure_ev is the camera's own */
};

/* `out` is filled again. The same errors as tonemap_options_check; release after a failure, too. */
status output_options_check(const struct output_options *o, struct output_request *out, struct error *err) MUST_CHECK;
void output_request_release(struct output_request *request);

/* `formats` in place of the request's. */
void output_message_set(struct wire_output *out, const struct output_request *request, unsigned formats);

/* The format that a path's extension names (.exr, .png, .jpg, .jpeg); 0: none of them. */
unsigned output_format_of(const char *path);

/* The bits of enum output_format that a message names. */
unsigned output_message_formats(const Azulejo__Wire__OutputSettings *message);

/* The percentile that a message's automatic exposure takes. */
double output_percentile(const Azulejo__Wire__OutputSettings *message);
