/* A preview that differs from the job's pictures as its request says. */
#include <string.h>

#include "coordinator/net/session/session_messages.h"

enum { PARAMETER_PREFIX = 6 }; /* "param." */

/* NULL: not given. */
static const char *value_of(const Azulejo__Wire__OutputGet *asked, const char *name)
{
    for (size_t i = 0; i < asked->n_look; i++)
        if (strcmp(asked->look[i]->key, name) == 0)
            return asked->look[i]->value;
    return NULL;
}

/* param.NAME: the operator's own. */
static status take_parameters(const Azulejo__Wire__OutputGet *asked, struct tonemap_settings *t, struct error *err)
{
    status s = STATUS_OK;

    for (size_t i = 0; s == STATUS_OK && i < asked->n_look; i++)
        if (strncmp(asked->look[i]->key, "param.", PARAMETER_PREFIX) == 0)
            s = tonemap_settings_set_text(t, asked->look[i]->key + PARAMETER_PREFIX, asked->look[i]->value, err);
    return s;
}

static status take_operator(const Azulejo__Wire__OutputGet *asked, struct tonemap_settings *t, struct error *err)
{
    const char *name = value_of(asked, "tonemap");
    struct tonemap_settings other;

    if (!name)
        return STATUS_OK;
    TRY(tonemap_settings_init(&other, name, err));
    t->op = other.op;
    memcpy(t->values, other.values, sizeof t->values);
    t->has_file = t->has_file && t->op->file_load;
    return STATUS_OK;
}

/* By the name of the field; the exposure by that of the option. */
static status take_settings(const Azulejo__Wire__OutputGet *asked, struct tonemap_settings *t, struct error *err)
{
    for (int i = 0; i < LOOK_COUNT; i++) {
        const struct setting *row = &look_rows[i];
        const char *text = value_of(asked, i == LOOK_exposure_ev ? row->option : row->name);

        if (i == LOOK_temporal || i == LOOK_denoise_around || !text)
            continue;
        if (row->kind == SETTING_KIND_NUMBER && row->initial == 0 && strcmp(text, "0") == 0)
            setting_reset(row, t); /* the option takes no default */
        else if (setting_parse(row, text, t, err) != STATUS_OK)
            return err ? err->code = STATUS_ERR_INPUT : STATUS_ERR_INPUT;
    }
    return STATUS_OK;
}

status session_look(struct output_settings *output, const Azulejo__Wire__OutputGet *asked, struct error *err)
{
    struct tonemap_settings *t = &output->tonemap;
    const char *no_dither = value_of(asked, "no_dither");
    status s = take_operator(asked, t, err);

    THEN(s, take_parameters(asked, t, err));
    THEN(s, take_settings(asked, t, err));
    if (no_dither)
        output->picture.plain = strcmp(no_dither, "0") != 0;
    return s == STATUS_OK ? tonemap_settings_validate(t, err) : s;
}
