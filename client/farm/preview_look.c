#include "client/farm/preview_look.h"

#include "client/farm/upload.h"

/* Is an operator's parameter or file given? */
static int has_parameters(const struct tonemap_options *o)
{
    int direct = 0;

    for (size_t i = 0; i < o->direct_count; i++)
        direct |= o->direct[i].value != NULL;
    return direct || o->parameters.count > 0 || o->file;
}

status preview_look_check(struct preview_look *look, int has_preview, struct error *err)
{
    const struct tonemap_options *tone = &look->tone;

    look->given = tone->tonemap || has_parameters(tone) || look->no_dither;
    for (int i = 0; i < LOOK_COUNT; i++)
        look->given |= tone->said[i].text != NULL;
    if (!look->given)
        return STATUS_OK;
    if (!has_preview)
        return error_set(err, STATUS_ERR_USAGE,
                         "--tonemap and the other options of the look go with --preview FILE.png; 'azulejo develop' makes "
                         "a job's finished pictures again");
    if (!tone->tonemap && has_parameters(tone))
        return error_set(err, STATUS_ERR_USAGE, "a parameter belongs to an operator: give --tonemap, too");
    return tonemap_options_check(tone, &look->request.tonemap, &look->request.tonemap_file, err);
}

static status send_file(const struct preview_look *look, struct connection *c, struct error *err)
{
    const struct output_request *request = &look->request;
    struct upload_item item = {request->tonemap.file, request->tonemap_file.data, request->tonemap_file.size};
    struct upload_progress sent;

    return request->tonemap.has_file ? upload_blobs(c, &item, 1, NULL, NULL, &sent, err) : STATUS_OK;
}

status preview_look_output(struct preview_look *look, struct connection *c, const Azulejo__Wire__JobInfo *job,
                           Azulejo__Wire__OutputSettings **out, struct error *err)
{
    static const Azulejo__Wire__OutputSettings none = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    const struct tonemap_options *tone = &look->tone;
    const Azulejo__Wire__OutputSettings *own = job->output ? job->output : &none;
    Azulejo__Wire__OutputSettings *m = &look->output.message;
    double camera_ev = own->camera_ev;

    *out = NULL;
    if (!look->given)
        return STATUS_OK;
    look->request.camera_ev = camera_ev;
    look->request.tonemap.exposure_ev += camera_ev;
    output_message_set(&look->output, &look->request, OUTPUT_FORMAT_PNG);
    if (!tone->tonemap) {
        m->tonemap = own->tonemap;
        m->n_parameters = own->n_parameters;
        m->parameters = own->parameters;
        m->tonemap_file = own->tonemap_file;
        m->tonemap_file_name = own->tonemap_file_name;
    }
    /* The percentile goes with the metering. */
#define OWN(o, KIND, type, name, ...)                                                                                  \
    if (!tone->said[LOOK_##name == LOOK_metering_percentile ? LOOK_metering : LOOK_##name].text)                       \
        m->name = own->name;
    LOOK_SETTINGS(OWN, )
#undef OWN
    m->no_dither = look->no_dither || own->no_dither;
    m->png_bits = own->png_bits;
    *out = m;
    return send_file(look, c, err);
}

void preview_look_release(struct preview_look *look) { output_request_release(&look->request); }
