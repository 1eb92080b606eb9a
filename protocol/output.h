/* output: the pictures that a job makes, in C and as a message. */
#pragma once

#include "common/base/digest.h"
#include "common/image/image.h"
#include "common/tonemap/tonemap.h"
#include "protocol/azulejo.pb-c.h"

struct output_settings {
    int exr_half;
    int exr, png, jpg;               /* which files are made; at least one */
    struct picture_options picture;  /* of the PNG and the JPEG */
    struct tonemap_settings tonemap; /* op is never NULL */
    double camera_ev;                /* what of tonemap.exposure_ev is the camera's own */
};

/* An OutputSettings message and all that it points at; stays where it is while the message is in use. */
struct wire_output {
    Azulejo__Wire__OutputSettings message;
    Azulejo__Wire__OutputSettings__ParametersEntry entries[TONEMAP_PARAMETERS_MAX];
    Azulejo__Wire__OutputSettings__ParametersEntry *entry_pointers[TONEMAP_PARAMETERS_MAX];
    char *formats[3];
    struct digest file;
    char file_name[TONEMAP_FILE_NAME_MAX + 1];
};
void wire_output_set(struct wire_output *out, const struct output_settings *in);
/* The other way, every range checked; NULL gives the presets. ERR_INPUT. */
status wire_output_get(struct output_settings *out, const Azulejo__Wire__OutputSettings *in,
                       struct error *err) MUST_CHECK;
