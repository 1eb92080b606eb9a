/* MTL: a Wavefront material becomes the scene's model.
 *
 *   Kd             base_color; a black Kd under a map_Kd counts as white
 *   Ns             roughness = alpha^(1/2), alpha = (2 / (Ns + 2))^(1/2): the GGX width that
 *                  matches a Blinn-Phong lobe (Walter et al. 2007, equation for alpha_p); 1000 and
 *                  above, the top of the scale, is perfectly smooth
 *   Ks             illum 3, 5, 8 (reflection): the reflectance at normal incidence. illum 2 or
 *                  none (a highlight): 0.08 Ks, so that 0.5 is an ordinary plastic, as Blender
 *                  reads and writes it. illum 0, 1: no highlight
 *   Ni             index of refraction of what refracts (illum 6, 7)
 *   d, Tr, map_d   opacity (Tr: 1 - d, where d is missing): the surface dissolves; with illum 6 or 7, 1 - d refracts (all, if d
 *                  is 1), tinted by Tf
 *   Ke             radiance
 *   Pr Pm Pc Pcr Ps aniso anisor   roughness, metallic, clearcoat, its roughness, sheen,
 *                  anisotropy, its rotation in turns. With Pr, Pm or a map of
 *                  them, Ks is not used.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/obj/obj.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

static const float highlight_reflectance = 0.08f;
static const float default_reflectance = 0.04f; /* of ior 1.5 */
static const float smooth_exponent = 1000;
static const float sheen_roughness = 0.5f;
static const float grey = 0.8f; /* of faces without a material */

void obj_material_release(struct obj_material *material)
{
    for (int i = 0; i < OBJ_MAP_COUNT; i++)
        mem_free(material->maps[i].file);
}

/* ---- reading -------------------------------------------------------------------------------- */

static void material_init(struct obj_material *m)
{
    float *numbers[] = {&m->ns, &m->ni,  &m->d,  &m->tr,    &m->pr,    &m->pm,
                        &m->pc, &m->pcr, &m->ps, &m->aniso, &m->anisor};

    memset(m, 0, sizeof *m);
    m->illum = -1;
    m->row = BUILDER_NO_ROW;
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        *numbers[i] = NAN;
    for (int c = 0; c < 3; c++)
        m->kd[c] = m->ks[c] = m->ke[c] = m->tf[c] = NAN;
}

/* The place of a statement. */
struct mtl_place {
    struct obj *o;
    const char *file;
    uint32_t line;
};

static void warn_number(const struct mtl_place *at, struct obj_word word)
{
    builder_warn_at(at->o->b, at->file, at->line, "MTL value", "\"%.*s\" has no value that can be used: left out",
                    (int)(word.length < 24 ? word.length : 24), word.text);
}

/* "r", or "r g b"; spectral curves and CIE colours are not read. */
static void read_color(const struct mtl_place *at, struct obj_line *line, struct obj_word word, float out[3])
{
    double x[3];
    size_t count = obj_numbers(line, 3, x);

    if (count == 0) {
        warn_number(at, word);
        return;
    }
    for (size_t c = 0; c < 3; c++) {
        double value = count == 3 ? x[c] : x[0];
        out[c] = value >= 0 ? (float)fmin(value, 1e9) + 0.0f : 0.0f;
    }
}

static void read_number(const struct mtl_place *at, struct obj_line *line, struct obj_word word, float *out)
{
    double x;

    if (obj_numbers(line, 1, &x) && fabs(x) <= 1e9)
        *out = (float)x;
    else
        warn_number(at, word);
}

/* An option of a map that is not applied; `why` goes on from its name. */
static void warn_option(const struct mtl_place *at, struct obj_word option, const char *why)
{
    char kind[32];

    snprintf(kind, sizeof kind, "MTL option %.*s", (int)option.length, option.text);
    builder_warn_at(at->o->b, at->file, at->line, kind, "%.*s %s", (int)option.length, option.text, why);
}

/* Options of a map, then its file, whose name may hold spaces. */
static void read_map(const struct mtl_place *at, struct obj_line *line, struct obj_word word, struct obj_texture *map)
{
    struct obj_word rest;
    double x[3];

    mem_free(map->file);
    *map = (struct obj_texture){.line = at->line, .scale = {1, 1}, .bump = 1};
    for (;;) {
        struct obj_line before = *line;
        struct obj_word option = obj_next_word(line);
        if (option.length < 2 || option.text[0] != '-') {
            *line = before;
            break;
        }
        if (obj_word_is(option, "-s") || obj_word_is(option, "-o") || obj_word_is(option, "-t")) {
            float *to = obj_word_is(option, "-s") ? map->scale : map->offset;
            size_t count = obj_numbers(line, 3, x);
            if (obj_word_is(option, "-t") && count > 0)
                warn_option(at, option, "is not applied: the map is not distorted");
            for (size_t c = 0; c < 2 && c < count && !obj_word_is(option, "-t"); c++)
                to[c] = fabs(x[c]) <= 1e6 ? (float)x[c] : to[c];
        } else if (obj_word_is(option, "-bm")) {
            map->bump = obj_numbers(line, 1, x) && fabs(x[0]) <= 1e6 ? (float)x[0] : 1.0f;
        } else if (obj_word_is(option, "-mm")) {
            obj_numbers(line, 2, x);
            warn_option(at, option, "is not applied: the map is used as it is");
        } else if (obj_word_is(option, "-boost") || obj_word_is(option, "-texres")) {
            obj_numbers(line, 1, x);
        } else if (obj_word_is(option, "-clamp")) {
            map->clamp = obj_word_is(obj_next_word(line), "on");
        } else if (obj_word_is(option, "-cc")) {
            if (obj_word_is(obj_next_word(line), "on"))
                warn_option(at, option, "is not applied: the map's colours are not corrected");
        } else if (obj_word_is(option, "-blendu") || obj_word_is(option, "-blendv") || obj_word_is(option, "-type")) {
            obj_next_word(line);
        } else if (obj_word_is(option, "-imfchan")) {
            option = obj_next_word(line);
            map->channel = option.length == 1 && strchr("rgbml", option.text[0]) ? option.text[0] : 0;
            if (!map->channel)
                builder_warn_at(at->o->b, at->file, at->line, "MTL option", "-imfchan %.*s is not applied: r, g, b, m and l are",
                                (int)(option.length < 24 ? option.length : 24), option.text);
        } else { /* a name that begins so */
            *line = before;
            break;
        }
    }
    rest = obj_rest(line);
    if (rest.length == 0 || rest.length > OBJ_NAME_BYTES_MAX || memchr(rest.text, 0, rest.length)) {
        warn_number(at, word);
        return;
    }
    map->file = must(mem_alloc(rest.length + 1));
    memcpy(map->file, rest.text, rest.length);
    map->file[rest.length] = 0;
}

static void read_statement(const struct mtl_place *at, struct obj_line *line, struct obj_word word,
                           struct obj_material *m)
{
    const struct {
        const char *word;
        float *color, *number;
    } values[] = {{"Kd", m->kd, NULL},         {"Ks", m->ks, NULL},  {"Ke", m->ke, NULL},
                  {"Tf", m->tf, NULL},         {"Ns", NULL, &m->ns}, {"Ni", NULL, &m->ni},
                  {"Pr", NULL, &m->pr},        {"Pm", NULL, &m->pm}, {"Pc", NULL, &m->pc},
                  {"Pcr", NULL, &m->pcr},      {"Ps", NULL, &m->ps}, {"aniso", NULL, &m->aniso},
                  {"anisor", NULL, &m->anisor}};
    static const struct {
        const char *word;
        enum obj_map map;
    } maps[] = {{"map_Kd", OBJ_MAP_KD},   {"map_Ks", OBJ_MAP_KS},     {"map_Ke", OBJ_MAP_KE},
                {"map_d", OBJ_MAP_D},     {"map_Bump", OBJ_MAP_BUMP}, {"bump", OBJ_MAP_BUMP},
                {"norm", OBJ_MAP_NORMAL}, {"map_Kn", OBJ_MAP_NORMAL}, {"map_norm", OBJ_MAP_NORMAL},
                {"map_Pr", OBJ_MAP_PR},   {"map_Pm", OBJ_MAP_PM}};
    static const char *const silent[] = {"Ka", "map_Ka", "sharpness", "map_aat"};
    char kind[64];
    float value;

    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        if (obj_word_is(word, values[i].word)) {
            if (values[i].color)
                read_color(at, line, word, values[i].color);
            else
                read_number(at, line, word, values[i].number);
            return;
        }
    for (size_t i = 0; i < sizeof maps / sizeof *maps; i++)
        if (obj_word_is(word, maps[i].word)) {
            read_map(at, line, word, &m->maps[maps[i].map]);
            return;
        }
    if (obj_word_is(word, "d") || obj_word_is(word, "Tr")) {
        struct obj_line before = *line;
        if (!obj_word_is(obj_next_word(line), "-halo"))
            *line = before;
        value = NAN;
        read_number(at, line, word, &value);
        if (!isnan(value))
            *(obj_word_is(word, "d") ? &m->d : &m->tr) = value;
        return;
    }
    if (obj_word_is(word, "illum")) {
        value = -1;
        read_number(at, line, word, &value);
        m->illum = value >= 0 && value <= 10 ? (int)value : -1;
        return;
    }
    for (size_t i = 0; i < sizeof silent / sizeof *silent; i++)
        if (obj_word_is(word, silent[i]))
            return;
    snprintf(kind, sizeof kind, "MTL %.*s", (int)(word.length < 24 ? word.length : 24), word.text);
    builder_warn_at(at->o->b, at->file, at->line, kind, "the material statement \"%.*s\" is not read",
                    (int)(word.length < 24 ? word.length : 24), word.text);
}

static void begin_material(struct obj *o, struct obj_line *line, uint32_t file)
{
    struct obj_word name = obj_rest(line);
    uint32_t number = obj_intern(&o->materials, name.text, name.length);

    MUST_GROW(o->defined, o->defined_capacity, o->defined_count + 1);
    material_init(&o->defined[o->defined_count]);
    o->defined[o->defined_count].name = number;
    o->defined[o->defined_count].file = file;
    o->defined[o->defined_count].line = line->number;
    o->defined_count++;
}

static void read_library_text(struct obj *o, const struct buffer *bytes, const char *file)
{
    uint32_t number = obj_intern(&o->files, file, strlen(file));
    struct obj_text text = {(const char *)bytes->data, (const char *)bytes->data + bytes->size, 1};
    struct obj_line line;
    int begun = 0;

    if (bytes->size >= 3 && memcmp(text.at, "\xef\xbb\xbf", 3) == 0)
        text.at += 3;
    while (obj_next_line(&text, &line)) {
        const struct mtl_place at = {o, file, line.number};
        struct obj_word word = obj_next_word(&line);
        if (word.length == 0)
            continue;
        if (obj_word_is(word, "newmtl")) {
            begin_material(o, &line, number);
            begun = 1;
        } else if (begun) {
            read_statement(&at, &line, word, &o->defined[o->defined_count - 1]);
            obj_warn_of_odd(o, file, &line);
        } else {
            builder_warn_at(o->b, file, line.number, "before newmtl", "comes before any newmtl: left out");
        }
    }
}

/* A failure is a warning. *found tells whether the file could be read. */
static status read_library(struct obj *o, const char *file, uint32_t library, int warn, int *found)
{
    struct buffer bytes = BUFFER_INIT;
    struct error inner = {0};
    char kind[sizeof inner.text];
    status result = obj_read_file(o, NULL, file, OBJ_MTL_BYTES_MAX, &bytes, &inner);

    *found = result == STATUS_OK;
    if (result == STATUS_OK && bytes.size) {
        read_library_text(o, &bytes, file);
    } else if (result == STATUS_ERR_NO_MEMORY) {
        result = error_no_memory(o->err, "an MTL file");
    } else if (result == STATUS_ERR_FORBIDDEN || (result != STATUS_OK && warn && o->b->options->strict)) {
        result = error_set(o->err, result, "line %u: mtllib: %s", o->library_lines[library], inner.text);
    } else {
        snprintf(kind, sizeof kind, "mtllib %.200s", file);
        if (result != STATUS_OK && warn)
            builder_warn_at(o->b, o->name, o->library_lines[library], kind,
                            "the material library \"%.200s\" cannot be read (%.300s): its "
                            "materials are grey",
                            file, inner.text);
        result = STATUS_OK;
    }
    buffer_release(&bytes);
    return result;
}

/* Read the libraries of an mtllib statement one by one. */
static status read_libraries_of(struct obj *o, uint32_t library)
{
    const char *all = o->libraries.texts[library];
    struct obj_line line = {.at = all, .end = all + strlen(all)};
    struct obj_word word;
    int found;

    while ((word = obj_next_word(&line)).length) {
        char file[OBJ_NAME_BYTES_MAX + 1];
        snprintf(file, sizeof file, "%.*s", (int)word.length, word.text);
        TRY(read_library(o, file, library, 1, &found));
    }
    return STATUS_OK;
}

status obj_read_libraries(struct obj *o)
{
    for (uint32_t i = 0; i < o->libraries.count; i++) {
        const char *all = o->libraries.texts[i];
        int several = strpbrk(all, " \t") != NULL, found;
        TRY(read_library(o, all, i, !several, &found));
        if (!found && several)
            TRY(read_libraries_of(o, i));
    }
    o->definition = must(mem_alloc_array(o->materials.count, sizeof *o->definition));
    memset(o->definition, 0xff, o->materials.count * sizeof *o->definition);
    for (size_t i = o->defined_count; i-- > 0;) /* the first of a name counts */
        o->definition[o->defined[i].name] = (uint32_t)i;
    return STATUS_OK;
}

/* ---- making --------------------------------------------------------------------------------- */

static float unit(float x, float otherwise) { return isnan(x) ? otherwise : float_min(float_max(x, 0), 1) + 0.0f; }

static int is_black(const float color[3]) { return !(color[0] > 0 || color[1] > 0 || color[2] > 0); }

static float roughness_of(const struct obj_material *in)
{
    if (!isnan(in->pr))
        return unit(in->pr, 1);
    if (isnan(in->ns))
        return 1;
    if (in->ns >= smooth_exponent)
        return 0;
    return sqrtf(sqrtf(2 / (float_max(in->ns, 0) + 2)));
}

static void set_specular(const struct obj_material *in, struct scene_material *out)
{
    int mirror = in->illum == 3 || in->illum == 5 || in->illum == 8;
    float scale = (mirror ? 1 : highlight_reflectance) / default_reflectance;

    if (!isnan(in->pr) || !isnan(in->pm) || in->maps[OBJ_MAP_PR].file || in->maps[OBJ_MAP_PM].file) {
        out->ior = in->ni >= 1 ? float_min(in->ni, 10) : 1.5f;
        return;
    }
    if (in->illum == 6 || in->illum == 7)
        return; /* a refracting surface reflects by its index */
    if (in->illum == 0 || in->illum == 1 || is_black(in->ks)) {
        out->specular = 0;
        return;
    }
    for (int c = 0; c < 3; c++)
        out->specular_color[c] = scale * unit(in->ks[c], 0);
}

static void set_opacity(const struct obj_material *in, struct scene_material *out)
{
    float d = unit(isnan(in->d) ? 1 - in->tr : in->d, 1);

    if (in->illum == 6 || in->illum == 7) {
        out->transmission = d < 1 ? 1 - d : 1;
        out->refractive = 1;
        out->ior = in->ni >= 1 ? float_min(in->ni, 10) : 1.5f;
        for (int c = 0; c < 3; c++)
            out->base_color[c] = out->base_color[c] * (1 - out->transmission) + unit(in->tf[c], 1) * out->transmission;
    } else if (d < 1 || in->maps[OBJ_MAP_D].file) {
        out->alpha_mode = ALPHA_BLEND;
        out->base_color[3] = d;
    }
}

static void set_values(const struct obj_material *in, struct scene_material *out)
{
    int map_alone = in->maps[OBJ_MAP_KD].file && (isnan(in->kd[0]) || is_black(in->kd));

    scene_material_default(out);
    out->double_sided = 1;
    out->metallic = in->maps[OBJ_MAP_PM].file ? unit(in->pm, 1) : unit(in->pm, 0);
    out->roughness = in->maps[OBJ_MAP_PR].file ? unit(in->pr, 1) : roughness_of(in);
    for (int c = 0; c < 3; c++) {
        out->base_color[c] = map_alone ? 1 : unit(in->kd[c], grey);
        out->emission[c] = !isnan(in->ke[c]) ? in->ke[c] : in->maps[OBJ_MAP_KE].file ? 1 : 0;
        out->sheen_color[c] = unit(in->ps, 0);
    }
    set_specular(in, out);
    set_opacity(in, out);
    out->sheen_roughness = sheen_roughness;
    out->clearcoat = unit(in->pc, 0);
    out->clearcoat_roughness = unit(in->pcr, 0);
    out->anisotropy = unit(in->aniso, 0);
    out->anisotropy_rotation_rad = isnan(in->anisor) ? 0 : 2 * PI_F * (in->anisor - floorf(in->anisor));
}

/* The material of faces without one: grey, or the vertices' colours. */
static status plain_row(struct obj *o, int colored, uint32_t *row)
{
    int64_t *known = colored ? &o->plain_colored_row : &o->plain_row;
    struct scene_material plain;

    if (*known == BUILDER_NO_ROW) {
        scene_material_default(&plain);
        plain.name = builder_name(o->b, "default");
        plain.double_sided = 1;
        plain.metallic = 0;
        plain.specular = 0;
        for (int c = 0; c < 3; c++)
            plain.base_color[c] = colored ? 1 : grey;
        TRY(builder_add_material(o->b, &plain, row));
        *known = *row;
    }
    *row = (uint32_t)*known;
    return STATUS_OK;
}

status obj_material_row(struct obj *o, uint32_t material, uint32_t line, int colored, uint32_t *row)
{
    struct scene_material out;
    struct obj_material *in;

    if (material == OBJ_NONE)
        return plain_row(o, colored, row);
    if (o->definition[material] == OBJ_NONE) {
        builder_warn_at(o->b, o->name, line, "unknown material",
                        "the material \"%.200s\" is in none of the libraries: grey is used",
                        o->materials.texts[material]);
        return plain_row(o, colored, row);
    }
    in = &o->defined[o->definition[material]];
    if (in->row == BUILDER_NO_ROW) {
        if (fabsf(in->d + in->tr - 1) > 0.01f)
            builder_warn_at(o->b, o->files.texts[in->file], in->line, "d and Tr",
                            "d %g and Tr %g contradict each other: d counts", (double)in->d, (double)in->tr);
        set_values(in, &out);
        out.name = builder_name(o->b, o->materials.texts[material]);
        TRY(obj_textures(o, in, &out));
        TRY(builder_add_material(o->b, &out, row));
        in->row = *row;
    }
    *row = (uint32_t)in->row;
    return STATUS_OK;
}
