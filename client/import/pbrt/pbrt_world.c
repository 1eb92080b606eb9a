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
    return pbrt_texture(p, name, type, &d);
}

void pbrt_material_new(struct pbrt *p, const char *kind, const char *name, const struct pbrt_place *at,
                       struct pbrt_material **out)
{
    struct pbrt_material *m = must(ARENA_NEW(&p->arena, struct pbrt_material));

    *out = m;
    m->kind = kind;
    m->name = name;
    m->at = *at;
    m->params = pbrt_params_copy(&p->params, &p->arena);
    if (!p->version3)
        return;
    /* Names mean what they mean here, however they are defined again. */
    pbrt_textures_bind(p, m->params);
    if (strcmp(kind, "mix") == 0)
        for (int i = 0; i < 2; i++)
            m->mix[i] = pbrt_name_find(&p->materials, pbrt_string(m->params, i ? "namedmaterial2" : "namedmaterial1", ""));
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
    struct pbrt_material *m;
    const char *name, *kind;

    TRY(need_world(p, "MakeNamedMaterial", at));
    TRY(pbrt_next_string(p, "MakeNamedMaterial", &name));
    TRY(pbrt_next_params(p, p->now.material_defaults));
    kind = pbrt_string(&p->params, "type", NULL);
    if (!kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the material \"%.80s\" has no \"string type\"", name);
    kind = pbrt_keep(p, kind);
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
    if (!m)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the material \"%.80s\" is not known: define it above with "
                         "MakeNamedMaterial",
                         name);
    p->now.material = m;
    return STATUS_OK;
}

static status do_make_medium(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d = {.at = *at, .ctm = p->now.ctm, .params = &p->params};
    const char *name;

    TRY(pbrt_next_string(p, "MakeNamedMedium", &name));
    TRY(pbrt_next_params(p, p->now.medium_defaults));
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
    return pbrt_shape(p, &d);
}

static status do_object_begin(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(need_world(p, "ObjectBegin", at));
    TRY(pbrt_next_string(p, "ObjectBegin", &name));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "an object cannot be defined inside of another one");
    TRY(pbrt_push(p, PBRT_STACK_OBJECT, at));
    p->object = must(ARENA_NEW(&p->arena, struct pbrt_object));
    if (pbrt_name_find(&p->objects, name)) /* its parts stay with the arena's owner until the end */
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the object \"%.80s\" is defined twice", name);
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
    const struct pbrt_object *object;
    const char *name;

    TRY(need_world(p, "ObjectInstance", at));
    TRY(pbrt_next_string(p, "ObjectInstance", &name));
    object = pbrt_name_find(&p->objects, name);
    if (!object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the object \"%.80s\" is not known", name);
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "an object cannot be placed in an object definition");
    return pbrt_object_place(p, object, at);
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
