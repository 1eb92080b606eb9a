#include "protocol/output.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "protocol/message.h"

void wire_output_set(struct wire_output *out, const struct output_settings *in)
{
    static char exr[] = "exr", png[] = "png", jpg[] = "jpg";
    Azulejo__Wire__OutputSettings message = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    const struct tonemap_operator *op = in->tonemap.op;

    out->message = message;
    out->message.exr_half = in->exr_half;
    out->message.tonemap = (char *)op->name;
#define SETTING(o, KIND, type, name, ...) SET_##KIND(name)
#define SET_NUMBER(name) out->message.name = in->tonemap.name;
#define SET_WHOLE(name) SET_NUMBER(name)
#define SET_CHOICE(name) out->message.name = (char *)choice_word(look_rows[LOOK_##name].choice, in->tonemap.name);
    LOOK_SETTINGS(SETTING, )
#undef SETTING
    out->message.camera_ev = in->camera_ev;
    for (size_t i = 0; i < op->parameter_count; i++) {
        Azulejo__Wire__OutputSettings__ParametersEntry entry = AZULEJO__WIRE__OUTPUT_SETTINGS__PARAMETERS_ENTRY__INIT;
        entry.key = (char *)op->parameters[i].name;
        entry.value = in->tonemap.values[i];
        out->entries[i] = entry;
        out->entry_pointers[i] = &out->entries[i];
    }
    out->message.n_parameters = op->parameter_count;
    out->message.parameters = out->entry_pointers;
    if (in->tonemap.has_file) {
        out->file = in->tonemap.file;
        wire_digest_set(&out->message.tonemap_file, &out->file);
        memcpy(out->file_name, in->tonemap.file_name, sizeof out->file_name);
        out->message.tonemap_file_name = out->file_name;
    }
    out->message.png_bits = (uint32_t)in->picture.bits;
    out->message.jpeg_quality = (uint32_t)in->picture.quality;
    out->message.no_dither = in->picture.plain;
    if (in->exr)
        out->formats[out->message.n_formats++] = exr;
    if (in->png)
        out->formats[out->message.n_formats++] = png;
    if (in->jpg)
        out->formats[out->message.n_formats++] = jpg;
    out->message.formats = out->formats;
}

/* The settings of the display files. */
static status picture_get(struct output_settings *out, const Azulejo__Wire__OutputSettings *in, struct error *err)
{
    char text[64];

    if (in->png_bits != 0 && in->png_bits != 8 && in->png_bits != 16)
        return error_set(err, STATUS_ERR_INPUT, "a PNG has 8 or 16 bits, not %u", in->png_bits);
    if (in->jpeg_quality > 100)
        return error_set(err, STATUS_ERR_INPUT, "a JPEG's quality is 1 to 100, not %u",
                         in->jpeg_quality);
    out->picture = (struct picture_options){
        .bits = (int)in->png_bits, .plain = in->no_dither, .quality = (int)in->jpeg_quality};
    for (size_t i = 0; i < in->n_formats; i++) {
        if (strcmp(in->formats[i], "exr") == 0)
            out->exr = 1;
        else if (strcmp(in->formats[i], "png") == 0)
            out->png = 1;
        else if (strcmp(in->formats[i], "jpg") == 0)
            out->jpg = 1;
        else
            return error_set(err, STATUS_ERR_INPUT, "output format '%s': must be exr, png or jpg",
                             message_text(text, sizeof text, in->formats[i]));
    }
    if (in->n_formats == 0)
        out->exr = out->png = 1;
    return STATUS_OK;
}

static status tonemap_get(struct tonemap_settings *out, const Azulejo__Wire__OutputSettings *in, struct error *err)
{
    size_t count;
    const struct tonemap_operator *const *first = tonemap_operators(&count);
    char text[64];
    int number;
    status s = tonemap_settings_init(out, in->tonemap[0] ? in->tonemap : first[0]->name, err);

    for (size_t i = 0; s == STATUS_OK && i < in->n_parameters; i++)
        s = tonemap_settings_set(out, in->parameters[i]->key, in->parameters[i]->value, err);
    if (s != STATUS_OK)
        return s;
#define SETTING(o, KIND, type, name, ...) GET_##KIND(type, name)
#define GET_NUMBER(type, name) out->name = in->name;
#define GET_WHOLE(type, name) GET_NUMBER(type, name)
#define GET_CHOICE(type, name)                                                                                         \
    number = in->name[0] ? choice_find(look_rows[LOOK_##name].choice, in->name) : 0;                                   \
    if (number < 0)                                                                                                    \
        return error_set(err, STATUS_ERR_INPUT, #name " '%s': must be one of %s",                                      \
                         message_text(text, sizeof text, in->name), look_rows[LOOK_##name].words);                     \
    out->name = (type)number;
    LOOK_SETTINGS(SETTING, )
#undef SETTING
    for (int i = 0; i < LOOK_COUNT; i++)
        setting_default_absent(&look_rows[i], out);
    if (in->tonemap_file.len > 0) {
        TRY(wire_digest_get(&out->file, &in->tonemap_file, "the operator's file", err));
        out->has_file = 1;
        message_text(out->file_name, sizeof out->file_name, in->tonemap_file_name);
    }
    return tonemap_settings_validate(out, err);
}

status wire_output_get(struct output_settings *out, const Azulejo__Wire__OutputSettings *in, struct error *err)
{
    static const Azulejo__Wire__OutputSettings none = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    status s;

    memset(out, 0, sizeof *out);
    if (!in)
        in = &none;
    s = tonemap_get(&out->tonemap, in, err);
    THEN(s, picture_get(out, in, err));
    out->exr_half = in->exr_half;
    if (s == STATUS_OK && !(fabs(in->camera_ev) <= look_rows[LOOK_exposure_ev].most))
        return error_set(err, STATUS_ERR_INPUT, "the camera's exposure must be at most %g stops either way",
                         look_rows[LOOK_exposure_ev].most);
    out->camera_ev = in->camera_ev;
    return s;
}
