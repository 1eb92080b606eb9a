/* The directives after WorldBegin: textures, materials, media, lights, shapes and objects. */
#include <string.h>

#include "client/terminal/must.h"
#include "client/import/pbrt/read/pbrt_directive.h"

static status need_world(struct pbrt *p, const char *word, const struct pbrt_place *at)
{
    if (p->in_world)
        return STATUS_OK;
    return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must come after WorldBegin", word);
}

static status do_texture(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name, *type;
    struct pbrt_directive d;

    TRY(need_world(p, "Texture", at));
    TRY(pbrt_next_string(p, "Texture", &name));
    TRY(pbrt_next_string(p, "Texture", &type));
    TRY(pbrt_read_directive(p, "Texture", p->now.texture_defaults, at, &d));
    TRY(pbrt_define(p, strcmp(type, "float") == 0 ? "float texture" : "spectrum texture", name, at));
    return pbrt_now_or_late(p, LATE_TEXTURE, name, type, &d);
}

static struct pbrt_material *named_material(struct pbrt *p, const char *name, const struct pbrt_place *at)
{
    struct pbrt_material *m = must(ARENA_NEW(&p->arena, struct pbrt_material));

    m->name = name;
    m->at = *at;
    return m;
}

/* Give it its kind and a copy of p->params. */
static void define_material(struct pbrt *p, struct pbrt_material *m, const char *kind)
{
    m->kind = kind;
    m->params = pbrt_params_copy(&p->params, &p->arena);
    if (!p->version3)
        return;
    /* Names mean what they mean here, however they are defined again. */
    pbrt_textures_bind(p, m->params);
    if (strcmp(kind, "mix") == 0)
        for (int i = 0; i < 2; i++)
            m->mix[i] = pbrt_name_find(&p->materials, pbrt_string(m->params, i ? "namedmaterial2" : "namedmaterial1", ""));
}

void pbrt_material_new(struct pbrt *p, const char *kind, const char *name, const struct pbrt_place *at,
                       struct pbrt_material **out)
{
    *out = named_material(p, name, at);
    define_material(p, *out, kind);
}

static status do_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "Material", at));
    TRY(pbrt_read_directive(p, "Material", p->now.material_defaults, at, &d));
    pbrt_material_new(p, d.kind, d.kind, at, &p->now.material);
    return STATUS_OK;
}

static status do_make_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_material *m = NULL;
    const char *name, *kind;

    TRY(need_world(p, "MakeNamedMaterial", at));
    TRY(pbrt_next_string(p, "MakeNamedMaterial", &name));
    TRY(pbrt_next_params(p, p->now.material_defaults));
    kind = pbrt_string(&p->params, "type", NULL);
    if (!kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the material \"%.80s\" has no \"string type\"", name);
    kind = pbrt_keep(p, kind);
    TRY(pbrt_define(p, "material", name, at));
    if (!p->version3)
        m = pbrt_name_find(&p->materials, name); /* it was used above */
    if (m) {
        m->at = *at;
        define_material(p, m, kind);
        return STATUS_OK;
    }
    pbrt_material_new(p, kind, name, at, &m);
    pbrt_name_set_here(p, &p->materials, name, m);
    return STATUS_OK;
}

static status do_named_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_material *m;
    const char *name;

    TRY(need_world(p, "NamedMaterial", at));
    TRY(pbrt_next_string(p, "NamedMaterial", &name));
    m = pbrt_name_find(&p->materials, name);
    if (!m && p->version3)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the material \"%.80s\" is not known: define it above with "
                         "MakeNamedMaterial",
                         name);
    if (!m) {
        m = named_material(p, name, at);
        pbrt_name_set(p, &p->materials, name, m);
    }
    p->now.material = m;
    return STATUS_OK;
}

static status do_make_medium(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d = {.at = *at, .ctm = p->now.ctm, .params = &p->params};
    const char *name;

    TRY(pbrt_next_string(p, "MakeNamedMedium", &name));
    TRY(pbrt_next_params(p, p->now.medium_defaults));
    TRY(pbrt_define(p, "medium", name, at));
    d.kind = pbrt_string(&p->params, "type", "");
    pbrt_medium(p, name, &d);
    return STATUS_OK;
}

static status do_light(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "LightSource", at));
    TRY(pbrt_read_directive(p, "LightSource", p->now.light_defaults, at, &d));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "a light cannot be in an object definition");
    return pbrt_light(p, &d);
}

static status do_area_light(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_area_light *light;
    struct pbrt_directive d;

    TRY(need_world(p, "AreaLightSource", at));
    TRY(pbrt_read_directive(p, "AreaLightSource", p->now.light_defaults, at, &d));
    if (strcmp(d.kind, "diffuse") != 0 && strcmp(d.kind, "area") != 0) {
        pbrt_warn(p, at, "area light kind", "the area light \"%.60s\" is not known: left out", d.kind);
        p->now.area_light = NULL;
        return STATUS_OK;
    }
    light = must(ARENA_NEW(&p->arena, struct pbrt_area_light));
    light->at = *at;
    light->params = pbrt_params_copy(&p->params, &p->arena);
    p->now.area_light = light;
    p->b->has_light = 1;
    return STATUS_OK;
}

static status do_shape(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "Shape", at));
    TRY(pbrt_read_directive(p, "Shape", p->now.shape_defaults, at, &d));
    return pbrt_now_or_late(p, LATE_SHAPE, NULL, NULL, &d);
}

static status do_object_begin(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(need_world(p, "ObjectBegin", at));
    TRY(pbrt_next_string(p, "ObjectBegin", &name));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "an object cannot be defined inside of another one");
    TRY(pbrt_push(p, PBRT_STACK_OBJECT, at));
    TRY(pbrt_define(p, "object", name, at));
    p->object = must(ARENA_NEW(&p->arena, struct pbrt_object));
    p->object->name = builder_name(p->b, name);
    p->object->former = p->last_object;
    p->last_object = p->object;
    pbrt_name_set(p, &p->objects, name, p->object);
    return STATUS_OK;
}

static status do_object_end(struct pbrt *p, const struct pbrt_place *at)
{
    TRY(pbrt_pop(p, PBRT_STACK_OBJECT, at));
    p->object = NULL;
    return STATUS_OK;
}

static status do_object_instance(struct pbrt *p, const struct pbrt_place *at)
{
    const struct pbrt_directive d = {.at = *at, .ctm = p->now.ctm};
    const char *name;

    TRY(need_world(p, "ObjectInstance", at));
    TRY(pbrt_next_string(p, "ObjectInstance", &name));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "an object cannot be placed in an object definition");
    return pbrt_now_or_late(p, LATE_INSTANCE, name, NULL, &d);
}

const struct pbrt_word pbrt_world_words[] = {
    {"Texture", do_texture},
    {"Material", do_material},
    {"MakeNamedMaterial", do_make_material},
    {"NamedMaterial", do_named_material},
    {"MakeNamedMedium", do_make_medium},
    {"LightSource", do_light},
    {"AreaLightSource", do_area_light},
    {"Shape", do_shape},
    {"ObjectBegin", do_object_begin},
    {"ObjectEnd", do_object_end},
    {"ObjectInstance", do_object_instance},
    {NULL, NULL},
};
